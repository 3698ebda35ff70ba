"""Contact labels: what the clip says bears reaches the tracker, and agreement is what it is rewarded for."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.envs.reference import ReferenceBank
from mimicbench.sensors.contact import BEARING, bearers, bears
from mimicbench.sensors.observations import TERMS
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.registry import TRACKERS
from mimicbench.track.tracker import Layout
from mimicbench.track.train import train_tracker
from stool import H1
from tracked import CLIPS, ONE_THREAD, SIT_CHAIR, FakePhysics, clip_set, context_of, moved_on, tiny

SPEC, PLAIN = TRACKERS.get("residual-contact"), TRACKERS.get("residual")
SETTINGS = SPEC.settings()
NAMES = ("pelvis", "back", "left_foot", "right_foot")


def labeled(motion):
    """The feet bear, and from frame 10 on the pelvis; of hands nothing is said."""
    bearing = np.zeros((motion.frames, 4), bool)
    bearing[:, 2:], bearing[10:, :2] = True, True
    return replace(motion, contact_names=NAMES, contacts=bearing)


def test_labels_are_those_of_the_nearest_frame():
    bank = ReferenceBank([CLIPS[0], labeled(replace(CLIPS[1], fps=25.0))], H1)
    clip, index = torch.tensor([0, 1, 1, 1]), torch.tensor([30, 18, 20, 999])
    found = bank.frame(clip, index).bears
    assert found.tolist() == [[0, 0, 0, 0, 0], [1, 1, 0, 0, 0], [1, 1, 1, 0, 0], [1, 1, 1, 0, 0]]
    context = context_of(ReferenceBank([labeled(CLIPS[1])], H1), 9)
    assert TERMS["bears+1"].compute(context).tolist() == [[1, 1, 1, 0, 0]], "of the next frame"
    assert Layout.of(SPEC, H1, [SIT_CHAIR]).names == (*Layout.of(PLAIN, H1, [SIT_CHAIR]).names, "bears+1")


def test_agreement_by_hand():
    bank = ReferenceBank([labeled(CLIPS[1])], H1)
    context = context_of(bank, 12)
    step = moved_on(bank, context, 11)
    plain = float(PLAIN.reward(context, step, SETTINGS)[0])
    parts = dict(zip(BEARING, bearers(H1), strict=True))
    assert [H1.link_names[link] for link in parts["left_hand"]] == ["left_elbow_link"]
    for pressed, agree in (
        ({}, 2),  # neither hand bears, and neither is to
        ({"left_foot": 2.0, "right_foot": 2.0, "pelvis": 2.0}, 5),
        ({"left_foot": 2.0, "right_foot": 0.5, "pelvis": 2.0}, 4),
        ({"left_foot": 2.0, "right_foot": 2.0, "pelvis": 2.0, "right_hand": 2.0}, 4),
    ):
        forces = torch.zeros(1, len(H1.links), 3)
        for part, newtons in pressed.items():
            forces[0, parts[part][-1], 2] = newtons
        physics = FakePhysics(context.physics.links(), context.object, forces)
        there = replace(context, physics=physics)
        assert bears(there, 1.0)[0].tolist() == [pressed.get(part, 0.0) > 1.0 for part in BEARING]
        assert float(SPEC.reward(there, step, SETTINGS)[0]) == pytest.approx(plain + 0.2 * agree / 5, abs=1e-5)


def test_it_learns_beside_a_stool_and_begins_from_one_that_was_told_nothing(tmp_path):
    clips = [clip_set(labeled(CLIPS[1]))]
    without = train_tracker(tmp_path / "plain", clips, [], tiny(1), 0, ONE_THREAD)
    config = replace(tiny(2), tracker="residual-contact", begin_from=str(without))
    rows = []
    made = train_tracker(tmp_path / "told", clips, [], config, 0, ONE_THREAD, rows.append)
    assert load_tracker(made, H1).layout.size == 172 and rows[-1]["k_train"] == 1.0
    assert rows[-1]["reward"] > 0.8 + 0.2 * 3 / 5, "who sits agrees about most of what bears"
