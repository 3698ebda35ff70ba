"""From what episodes came to, to the rows that every table is made of: each number in its own place, by hand."""

from dataclasses import replace
from math import nan

import mujoco
import numpy as np
import pytest
import torch

import mimicbench
from mimicbench.core import rotations as rot
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.metrics import PHASES, Verdict
from mimicbench.evaluate.rollout import Judged, PolicyRun, Protocol, policy_rows, run_policy, tracker_rows
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.track.rollout import RolloutConfig, track_clips
from stool import H1
from tracked import CLIPS, LIFT_BOX, OBJECTS, ONE_THREAD, SIT_CHAIR, STOOL, idle, still

BESIDE = replace(CLIPS[0], id="beside", root_pos_w=CLIPS[0].root_pos_w + np.array([1.75, -0.65, 0.0]))
"""0.3 m beyond the stool, which ends at 0.25 m, in x and 0.4 m in y: 0.5 m from it."""
CLIP_SET = ClipSet(SIT_CHAIR, H1, [*CLIPS, BESIDE], OBJECTS)
WHO = Judged("imitate", "somebody", "paper", 7)


def verdict(**changes):
    """Of three episodes: one fulfilled K after 5.5 s, one fell as it sat down, of one the physics broke down."""
    told = {
        "success": [True, False, False],
        "success_at_end": [False, False, True],
        "stays": [False, False, True],
        "first_success": [5.5, nan, nan],
        "fell": [False, True, False],
        "fell_time": [nan, 3.2, nan],
        "fell_phase": [0, PHASES.index("acting"), 0],
        "diverged": [False, False, True],
        "effort": [4e4, 5e6, 7.0],
        "steps": [1000, 999, 12],
    }
    return Verdict(**{name: torch.tensor(values) for name, values in {**told, **changes}.items()})


def part(found, first, last):
    """Some of the episodes, as a batch of their own."""
    return Verdict(**{name: value[first:last] for name, value in vars(found).items()})


def test_a_row_says_of_an_episode_what_it_came_to():
    found = verdict()
    runs = [
        PolicyRun(part(found, 0, 2), np.array([0.9, 0.8]), np.array([0.1, 0.2])),
        PolicyRun(part(found, 2, 3), np.array([0.7]), np.array([0.3]), {0: "act raised ValueError"}),
    ]
    first, second, third = policy_rows(runs, CLIP_SET, WHO)
    assert first == EpisodeRow(
        task="sit-chair",
        stage="imitate",
        policy="somebody",
        preset="paper",
        robot="h1",
        seed=7,
        episode=0,
        object_id=STOOL.id,
        object_kind="stool",
        split=STOOL.split,
        reference_id="stands",
        steps=275,  # K after 5.5 s of 0.02 s: there the episode ends, whatever the robot did later
        success=True,
        success_at_end=False,
        stays=False,
        first_success_time=5.5,
        fell=False,
        fell_time=None,
        fell_phase="",
        diverged=False,
        max_energy=4e4,
        seat_height=0.42,
        start_distance=0.9,
        end_distance=0.1,
        mimicbench=mimicbench.__version__,
        mujoco=mujoco.__version__,
    )
    assert second == replace(
        first,
        episode=1,
        reference_id="sits",
        steps=999,
        success=False,
        first_success_time=None,
        fell=True,
        fell_time=pytest.approx(3.2),
        fell_phase="sitting down",
        max_energy=5e6,
        start_distance=0.8,
        end_distance=0.2,
    )
    assert third == replace(
        first,
        episode=2,
        reference_id="beside",
        steps=12,
        success=False,
        success_at_end=True,
        stays=True,
        first_success_time=None,
        diverged=True,
        max_energy=7.0,
        start_distance=0.7,
        end_distance=0.3,
        error="act raised ValueError",
    )


def test_an_episode_that_is_judged_in_its_last_frame_has_all_its_steps():
    box = replace(CLIP_SET, task=LIFT_BOX)
    runs = [PolicyRun(verdict(), np.zeros(3), np.zeros(3))]
    assert [row.steps for row in policy_rows(runs, box, WHO)] == [1000, 999, 12]


def test_falls_are_told_in_the_words_of_the_task():
    found = verdict(fell=[True] * 3, fell_time=[1.0] * 3, fell_phase=[1, 2, 4])
    rows = policy_rows([PolicyRun(found, np.zeros(3), np.zeros(3))], CLIP_SET, WHO)
    assert [row.fell_phase for row in rows] == ["walking", "turning", "after success"]


@pytest.mark.parametrize(
    ("x", "y", "distance"),
    [(-1.2, 0.0, 0.95), (1.2, 0.0, 0.95), (0.1, -0.65, 0.4), (0.1, 0.65, 0.4), (0.55, -0.65, 0.5), (0.2, -0.2, 0.0)],
)
def test_a_trackers_distances_are_of_where_it_began_and_ended(x, y, distance):
    """From the rectangle of the stool, 0.5 m wide; not of the robot's height. It stands there for a tenth of a second,
    wherever its clip may lead. Batches are numbered on.
    """
    clip = still((np.array([x, y, 1.05]), np.zeros(19)), "there")
    elsewhere = np.tile([9.0, 9.0, 1.05], (clip.frames - 30, 1))
    clip = replace(clip, root_pos_w=np.concatenate([clip.root_pos_w[:30], elsewhere]))
    clips = replace(CLIP_SET, motions=[clip], task=replace(SIT_CHAIR, time_limit=0.1))
    run = track_clips(idle(), clips, RolloutConfig(settle=None), ONE_THREAD)
    rows = tracker_rows([run, run], replace(clips, motions=[clip, clip]), replace(WHO, stage="track"))
    assert [(row.stage, row.reference_id, row.episode, row.error) for row in rows] == [
        ("track", "there", number, "") for number in range(2)
    ]
    assert rows[0].start_distance == rows[1].start_distance == pytest.approx(distance, abs=1e-6)
    assert 0 < abs(rows[0].end_distance - distance) < 0.05 or rows[0].end_distance == distance == 0.0


class Stiff:
    """Keeps all joints at zero, until it raises in the step `tired`, counted from its reset."""

    observations = ("proprio",)
    gains = "improved"

    def __init__(self, tired=10**9):
        self.tired = tired

    def to(self, device):
        """It has nothing to move."""

    def reset(self, ids, obs):
        """An episode begins."""
        self.steps = 0

    def act(self, obs):
        """(N, 19) [rad]."""
        self.steps += 1
        if self.steps == self.tired:
            raise RuntimeError("tired")
        return torch.zeros(obs.num_envs, 19)


def always(body, obj):
    """K is fulfilled by whoever is there."""
    return body.pelvis_pos_w[:, 2] > -1.0  # of arrays and tensors alike


def never(body, obj):
    """K is fulfilled by nobody."""
    return ~always(body, obj)


def one_run(seconds, holds, policy=None):
    """The episode of the one who falls beside the stool, under a task of that length and condition."""
    task = replace(SIT_CHAIR, time_limit=seconds, hold_time=0.02, holds=holds)
    (run,) = run_policy(policy or Stiff(), replace(CLIP_SET, task=task, motions=[BESIDE]), env_config=ONE_THREAD)
    return run


def test_episodes_run_in_batches_and_those_that_are_asked_for_are_recorded():
    """Episodes 1 and 2 of three, in batches of two: the second of the first and the first of the second."""
    assert Protocol().batch == 128, "a part of the protocol"
    short, ticks, policy = replace(CLIP_SET, task=replace(SIT_CHAIR, time_limit=1.0)), [], Stiff()
    runs = run_policy(policy, short, Protocol(batch=2), [1, 2], ticks.append, ONE_THREAD)
    assert ticks == [1, 1] and [list(run.recordings) for run in runs] == [[1], [0]]
    for run, (episode, clip) in zip(runs, [(1, CLIPS[1]), (0, BESIDE)], strict=True):
        track = run.recordings[episode]
        assert track.shape[0] == 51, "the start and a second of steps"
        np.testing.assert_allclose(track[0, :7], [*clip.root_pos_w[0], *rot.IDENTITY], atol=1e-6)
    assert [run.start_distance.tolist() for run in runs] == [pytest.approx([0.95, 0.0]), pytest.approx([0.5])]
    assert [run.verdict.steps.tolist() for run in runs] == [[50, 50], [50]]
    (together,) = run_policy(Stiff(), short)
    assert together.verdict.steps.tolist() == [50, 50, 50], "all in one batch, unless it is told otherwise"
    assert policy.steps == 50 and not any(run.errors for run in runs), "it was reset before its first step alone"


def test_the_distance_at_the_end_is_that_at_the_fulfilment_of_k():
    """Whoever fulfils K in the first step is as far away as if the episode were over then; who never does, goes on."""
    first, last = (float(one_run(seconds, never).end_distance[0]) for seconds in (0.02, 0.2))
    assert abs(first - last) > 1e-4
    assert float(one_run(0.2, always).end_distance[0]) == first


def test_nothing_that_an_error_ended_was_done():
    """After 19 of 20 steps, K is fulfilled, holds, and has held for 0.3 s; the error takes all of it back."""
    done, failed = one_run(0.4, always).verdict, one_run(0.4, always, Stiff(20))
    names = ("success", "success_at_end", "stays")
    assert all(getattr(done, name).all() for name in names)
    assert not any(getattr(failed.verdict, name).any() for name in names)
    assert failed.verdict.steps.tolist() == [19] and list(failed.errors) == [0]
