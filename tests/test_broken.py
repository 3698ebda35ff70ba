"""Scenes whose physics breaks: they alone end, are reported once, and their last step runs again from a file."""

import logging

import numpy as np
import pytest
import torch

import stool
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.chair import make_chair
from mimicbench.sim.broken import MAX_KEPT, BrokenScene, load_broken, replay
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.timing import SUBSTEPS
from stool import H1, block, place, standing

POS, JOINTS = standing()


def three(folder):
    """Three robots that stand beside three chairs."""
    physics = NativePhysics(H1, [make_chair(i) for i in range(3)], PhysicsConfig(broken_dir=folder), workers=1)
    place(physics, POS, JOINTS)
    return physics


def targets(physics):
    return torch.tensor(JOINTS).repeat(physics.num_envs, 1)


def test_only_the_broken_scene_ends(tmp_path, caplog, monkeypatch):
    monkeypatch.chdir(tmp_path)
    whole, broken = three(tmp_path / "whole"), three(tmp_path)
    for physics in (whole, broken):
        physics.step(targets(physics))
    broken.qpos()[1, 10] = np.nan
    with caplog.at_level(logging.WARNING):
        for physics in (whole, broken):
            for _ in range(3):
                physics.step(targets(physics))
    assert broken.diverged.tolist() == [False, True, False] and not whole.diverged.any()
    np.testing.assert_array_equal(broken.qpos()[[0, 2]], whole.qpos()[[0, 2]])
    assert (broken.broken.count, whole.broken.count) == (1, 0), "it is reported once, not in every step"
    assert len(caplog.records) == 1 and make_chair(1).id in caplog.text and "positions are not finite" in caplog.text
    assert not (tmp_path / "whole").exists()
    found = load_broken(broken.broken.paths[0])
    assert (found.scene, found.obj.id, found.backend) == (1, make_chair(1).id, "native")
    assert np.flatnonzero(np.isnan(found.qpos)).tolist() == [10]
    assert "BADQPOS" in replay(found).warnings
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists(), "what breaks is told, not written into anybody's folder"


def test_every_reset_is_a_new_chance_to_be_reported(tmp_path):
    physics = three(tmp_path)
    for _ in range(2):
        physics.qvel()[2, 0] = 1e12
        physics.step(targets(physics))
        assert physics.diverged.tolist() == [False, False, True]
        stool.put(physics, np.array([2]), POS[None], rot.IDENTITY[None], JOINTS[None])
        assert not physics.diverged.any()
    assert physics.broken.count == 2


def test_targets_that_are_not_finite(tmp_path):
    physics = three(tmp_path)
    target = targets(physics)
    target[0, 4] = torch.nan
    physics.step(target)
    assert physics.diverged.tolist() == [True, False, False]
    found = load_broken(physics.broken.paths[0])
    assert "targets" in found.reason and np.isnan(found.target[4])
    assert replay(found).warnings == ("BADCTRL",)


def test_a_replay_goes_the_same_way_to_the_last_bit(tmp_path):
    box = make_box(3)
    physics = NativePhysics(H1, [box], PhysicsConfig(gains="paper", friction=0.6, mass=1.3), workers=1)
    place(physics, POS, JOINTS)
    random = np.random.default_rng(0)
    for _ in range(20):
        target = torch.tensor(JOINTS + 0.3 * random.normal(size=(1, 19)))
        warmstart = physics.batch.bind("qacc_warmstart")[0].copy()
        before = BrokenScene(
            "",
            0,
            "native",
            "h1",
            "paper",
            "position",
            box,
            physics.qpos()[0].copy(),
            physics.qvel()[0].copy(),
            warmstart,
            target[0].numpy(),
            np.array([0.0, 0.0, 60.0, 0.0, 5.0, 0.0]),
            0.6,
            1.3,
        )
        physics.assist(torch.tensor([[0.0, 0.0, 60.0]]), torch.tensor([[0.0, 5.0, 0.0]]))
        physics.step(target)
    before.save(tmp_path / "step.npz")
    again = replay(load_broken(tmp_path / "step.npz"))
    assert again.qpos.shape == (SUBSTEPS, 33) and again.warnings == ()
    np.testing.assert_array_equal(again.qpos[-1], physics.qpos()[0])
    np.testing.assert_array_equal(again.qvel[-1], physics.qvel()[0])


def test_a_thousand_broken_scenes_fill_no_disk(tmp_path, caplog):
    physics = NativePhysics(H1, [block()] * 20, PhysicsConfig(broken_dir=tmp_path), workers=1)
    place(physics, POS, JOINTS)
    physics.qvel()[:, 0] = np.nan
    with caplog.at_level(logging.WARNING):
        physics.step(targets(physics))
    assert physics.broken.count == 20 and len(list(tmp_path.iterdir())) == MAX_KEPT
    assert len(caplog.records) == MAX_KEPT + 1, "and the sixteenth, a power of two"


def test_a_dump_that_does_not_fit(tmp_path):
    good = BrokenScene(
        "",
        0,
        "native",
        "h1",
        "paper",
        "position",
        block(),
        np.zeros(26),
        np.zeros(25),
        np.zeros(25),
        np.zeros(18),
        np.zeros(6),
    )
    good.save(tmp_path / "scene.npz")
    with pytest.raises(BadFile, match="target is"):
        replay(load_broken(tmp_path / "scene.npz"))
    with pytest.raises(BadFile, match="does not exist"):
        load_broken(tmp_path / "none.npz")


def test_a_scene_that_cannot_be_written_ends_no_run(tmp_path, caplog):
    (tmp_path / "file").write_text("")
    physics = three(tmp_path / "file" / "folder")
    physics.qpos()[1, 10] = np.nan
    with caplog.at_level(logging.WARNING):
        physics.step(targets(physics))
    assert physics.diverged.tolist() == [False, True, False] and physics.broken.count == 1
    assert "could not be written" in caplog.text and not physics.broken.paths
