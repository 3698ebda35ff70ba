"""Trackers at work: clean targets under noise, worlds made worse, and to the time limit."""

from dataclasses import replace

import numpy as np
import torch

from mimicbench.envs.disturbance import Disturbance
from mimicbench.envs.vec_env import VecEnv
from mimicbench.track.rollout import RolloutConfig, track_clips
from stool import H1, seated
from tracked import (
    CLIPS,
    ONE_THREAD,
    SIT_CHAIR,
    STOOL,
    clip_set,
    idle,
    swing,
)


def test_recorded_targets_stay_clean():
    tracker = idle()
    calm, noisy = (
        track_clips(
            tracker, clip_set(CLIPS[1]), RolloutConfig(True, Disturbance(action_noise=noise), 1), ONE_THREAD
        ).recording
        for noise in (0.0, 0.05)
    )
    reference = torch.tensor(seated(0.42)[1], dtype=torch.float32)
    np.testing.assert_allclose(noisy.targets[0], np.tile(reference, (len(noisy.targets[0]), 1)), atol=1e-6)
    np.testing.assert_array_equal(calm.applied[0], calm.targets[0])
    assert 0.04 < (noisy.applied[0] - noisy.targets[0]).std() < 0.06
    assert not np.array_equal(calm.qpos[0], noisy.qpos[0])


def test_worlds_are_made_worse():
    calm = track_clips(idle(), clip_set(swing()), RolloutConfig(True), ONE_THREAD).recording.qpos[0]
    troubles = {
        "push": Disturbance(push=0.3, push_interval=0.1),
        "delay": Disturbance(delay=2),
        "friction": Disturbance(friction=0.3),
        "mass": Disturbance(mass=1.2),
        "noise": Disturbance(noise={"proprio": 0.05}),
    }
    for name, trouble in troubles.items():
        track = track_clips(idle(), clip_set(swing()), RolloutConfig(True, trouble), ONE_THREAD).recording.qpos[0]
        again = track_clips(idle(), clip_set(swing()), RolloutConfig(True, trouble), ONE_THREAD).recording.qpos[0]
        assert track.tobytes() == again.tobytes(), "the same seed, the same bytes"
        assert (track.tobytes() != calm.tobytes()) or name == "noise", "idle trackers sense nothing"
    env = VecEnv(SIT_CHAIR, H1, [STOOL], Disturbance(mass=1.1, friction=0.6).of(ONE_THREAD))
    light, heavy = VecEnv(SIT_CHAIR, H1, [STOOL], ONE_THREAD).physics.model(0), env.physics.model(0)
    links = slice(1, 1 + len(H1.links))
    np.testing.assert_allclose(heavy.body_mass[links], 1.1 * light.body_mass[links])
    np.testing.assert_allclose(heavy.body_inertia[links], 1.1 * light.body_inertia[links])
    np.testing.assert_allclose(heavy.geom_friction[:, 0], 0.6 * light.geom_friction[:, 0])
    np.testing.assert_array_equal(heavy.geom_friction[:, 1:], light.geom_friction[:, 1:])


def test_trackers_go_on_to_the_time_limit_when_asked():
    tracker = idle()
    clips = replace(clip_set(), task=replace(SIT_CHAIR, time_limit=3.0))
    verdict = track_clips(tracker, clips, RolloutConfig(settle=None), ONE_THREAD).verdict
    assert verdict.steps.tolist() == [150, 150] and verdict.stays.tolist() == [False, True]
    assert verdict.fell.tolist() == [True, False], "who only stands topples within seconds"
