"""An assisting wrench holds robots up while they learn, and fades."""

import pytest
import torch

from learning import ONE, clip_of
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import EndConfig, TrackingConfig
from mimicbench.track.tracking import TrackingEnv

FAR = EndConfig(max_pos_error=1e3, max_angle_error=1e3, max_drop=1e3, max_ankle_error=1e3)


def tracked(assist, steps=100):
    """Four robots from the first frame of a clip, that give no action of their own; nobody ends."""
    calm = ClipStartConfig(first_frame=1.0, pos_noise=0.0, angle_noise=0.0, vel_noise=0.0)
    config = TrackingConfig(calm, push=0.0, assist=assist, assist_steps=steps, ends=FAR)
    spec = TRACKERS.get("residual")
    return TrackingEnv(spec, clip_of(TASKS.get("sit-chair")), 4, config, 0, ONE), spec.settings()


def fallen(env, settings, steps):
    """How far their roots have sunk below their references [m]."""
    for _ in range(steps):
        env.step(torch.zeros(4, 19), settings)
    return float((env.context.reference(0).root_pos_w - env.context.state.root_pos_w)[:, 2].max())


def test_who_does_nothing_is_held_up():
    assert fallen(*tracked(0.0), 100) > 0.4
    assert fallen(*tracked(1.0, 100_000), 100) < 0.1


def test_it_fades_and_is_resumed():
    env, settings = tracked(0.8, 40)
    fallen(env, settings, 10)
    assert env._wrench.share == pytest.approx(0.8 * 30 / 40)
    again, _ = tracked(0.8, 40)
    again.load_state_tensors(env.state_tensors())
    assert again._wrench.share == env._wrench.share
    assert fallen(again, settings, 20) == fallen(env, settings, 20)
    fallen(env, settings, 30)
    assert env._wrench.share == 0.0
