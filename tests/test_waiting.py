"""Clips that wait for robots whose joints lag behind."""

import pytest
import torch

from learning import ONE, clip_of
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.sim.rows import Rows
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import EndConfig, TrackingConfig
from mimicbench.track.tracking import TrackingEnv

FAR = EndConfig(max_pos_error=1e3, max_angle_error=1e3, max_drop=1e3, max_ankle_error=1e3)
ROBOTS = 64
CALM = ClipStartConfig(first_frame=1.0, pos_noise=0.0, angle_noise=0.0, vel_noise=0.0)


def tracked(wait, robots=ROBOTS):
    """Robots from the first frame of a clip; nobody ends."""
    config = TrackingConfig(CALM, push=0.0, wait=wait, ends=FAR)
    spec = TRACKERS.get("residual")
    return TrackingEnv(spec, clip_of(TASKS.get("sit-chair")), robots, config, 0, ONE), spec.settings()


def steps(env, settings, count, away=0.0):
    """Where in the clip the robots are after so many steps of targets so far from the clip's [rad]."""
    for _ in range(count):
        target = env.context.reference(1).joint_pos + away
        env.step(torch.zeros(env.num_envs, 19), settings, target)
    return env.env.index.clone()


@pytest.mark.parametrize("wait", [0.0, 1.0])
def test_nobody_who_follows_is_waited_for(wait):
    assert (steps(*tracked(wait), 10) == 10).all()


def test_some_clips_wait_and_go_on_after_three_seconds():
    env, settings = tracked(0.5)
    index = steps(env, settings, 60, away=0.5)
    waited = index < 60
    assert 0.3 < waited.float().mean() < 0.7
    assert (index[~waited] == 60).all()
    assert (index[waited] < 20).all()
    later = steps(env, settings, 120, away=0.5)
    assert (later[waited] == 180 - 150).all()  # 3 s are 150 steps


def test_only_who_begins_anew_has_all_its_time_again():
    """Also where a GPU works out all rows, and those outside of the mask are to stay what they were."""
    for whole in (False, True):
        env, settings = tracked(1.0, 4)
        steps(env, settings, 30, away=0.5)
        waiting = env._waiting
        waited, may = waiting.waited.clone(), waiting.may.clone()
        assert (waited > 0).all() and may.all()
        begins = torch.tensor([False, True, False, False])
        waiting.begin(Rows.where(begins, whole), torch.Generator().manual_seed(0))
        assert waiting.waited.tolist() == torch.where(begins, 0, waited).tolist()
        assert waiting.may[~begins].all()


def test_who_catches_up_goes_on():
    env, settings = tracked(1.0, 4)
    steps(env, settings, 30, away=0.5)
    before = steps(env, settings, 30)
    assert (steps(env, settings, 10) == before + 10).all()


def test_it_is_resumed():
    env, settings = tracked(0.5)
    steps(env, settings, 30, away=0.5)
    again, _ = tracked(0.5)
    again.load_state_tensors(env.state_tensors())
    assert torch.equal(steps(again, settings, 140, away=0.5), steps(env, settings, 140, away=0.5))
    assert torch.equal(again.context.state.joint_pos, env.context.state.joint_pos)


def test_without_it_nothing_is_drawn_for_it():
    assert torch.equal(tracked(0.0)[0].random.get_state(), tracked(0.0)[0].random.get_state())
    assert not torch.equal(tracked(0.0)[0].random.get_state(), tracked(0.5)[0].random.get_state())
    assert not any(name.startswith("waiting/") for name in tracked(0.0)[0].state_tensors())
