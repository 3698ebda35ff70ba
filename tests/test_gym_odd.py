"""What environments do when starts move, objects differ in kind or share a name, and episodes are short or long."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import making
from mimicbench.core.errors import BadObject
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.gym import TaskEnv
from mimicbench.envs.lerobot.seen import make_one
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.shape import save_object
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.timing import CONTROL_DT

H1 = ROBOTS.get("h1")
REST = np.array(H1.rest_pose, np.float32)
FRAMES = 60


def walks(number=0, obj="chair-0-00000", speed=0.8):
    """Somebody who comes along the x axis."""
    time = np.arange(FRAMES) / 30
    pos = np.stack([1.5 - speed * time, 0.1 * number + 0 * time, 1.0 + 0 * time], -1)
    quat = np.tile([0.0, 0.0, 0.0, 1.0], (FRAMES, 1))
    what = (f"walk-{number}", "sit-chair", "h1", H1.joint_names, 30.0)
    return RobotMotion(*what, pos, quat, np.tile(REST, (FRAMES, 1)).astype(float), obj, f"walk-{number}")


def test_an_episode_that_begins_while_others_go_on_is_the_same_alone():
    """Odometry of moving starts, too."""
    given = {"split": "all", "starts": [walks(i) for i in range(4)], "observe": ("proprio", "odometry", "time")}
    envs = gymnasium.make_vec("mimicbench/SitChair-v0", num_envs=2, time_limit=3 * CONTROL_DT, **given)
    envs.reset(seed=0)
    actions = np.tile(REST, (2, 1))
    envs.step(actions)
    envs.reset(options={"reset_mask": np.array([False, True])})  # out of step from now on
    rows, seeds = [], []
    for _ in range(5):
        seen, *_, info = envs.step(actions)
        rows.append(seen["odometry"][0].copy())
        seeds.append(int(info["seed"][0]))
    begun = next(i for i in range(1, 5) if seeds[i] != seeds[i - 1])
    alone = gymnasium.make("mimicbench/SitChair-v0", time_limit=3 * CONTROL_DT, **given)
    expected = [alone.reset(seed=seeds[begun])[0], *(alone.step(REST)[0] for _ in range(4 - begun))]
    for row, seen in zip(rows[begun:], expected, strict=True):
        np.testing.assert_array_equal(row, seen["odometry"])
    assert not rows[begun].any() and abs(expected[-1]["odometry"][0]) > 0.01


def test_any_start_of_a_work_folder_may_come_first_whatever_its_object_is_made_of(tmp_path):
    """One object of boxes, one with convex pieces, as an import gives."""
    plain = replace(make_chair(0), id="plain")
    pieces = replace(make_chair(0), id="pieces", hulls=tuple(plain.corners()))
    objects, folder = tmp_path / "sit-chair" / "objects" / "own", tmp_path / "sit-chair" / "retarget" / "one"
    for obj in (plain, pieces):
        save_object(objects, obj)
    with making.by_hand(folder, "retarget", reads={"objects": objects}) as stage:
        for number, obj in enumerate((plain, pieces)):
            walks(number, obj.id).save(stage.folder / f"{obj.id}.npz")
        stage.finish()
    for order in ((0, 1), (1, 0)):
        env = TaskEnv("sit-chair", split="all", starts=tmp_path)
        met = {env.reset(seed=0, options={"start": start}) and env.object_ids()[0] for start in order}
        assert met == {"plain", "pieces"}


def test_a_stage_may_be_named_from_within(tmp_path, monkeypatch):
    objects, folder = tmp_path / "sit-chair" / "objects" / "own", tmp_path / "sit-chair" / "retarget" / "one"
    save_object(objects, replace(make_chair(0), id="own"))
    with making.by_hand(folder, "retarget", reads={"objects": objects}) as stage:
        walks(0, "own").save(stage.folder / "clip.npz")
        stage.finish()
    for inside, name in ((folder, "."), (folder.parent, "one")):
        monkeypatch.chdir(inside)
        env = TaskEnv("sit-chair", split="all", starts=name)
        assert env.reset(seed=0) and env.object_ids() == ["own"]


def test_two_objects_of_one_name_are_told():
    one, other = replace(make_chair(0), id="chair"), replace(make_chair(1), id="chair")
    with pytest.raises(BadObject, match="two objects are called chair"):
        TaskEnv("sit-chair", objects=[one, other], split="all")
    TaskEnv("sit-chair", objects=[one, one], split="all").reset(seed=0)


@pytest.mark.parametrize("limited", [{"max_steps": 4}, {"max_steps": None, "time_limit": 4 * CONTROL_DT}])
def test_short_episodes_are_rewarded_in_their_last_step(limited):
    env = make_one("sit-chair", split="all", terminate_on_success=False, **limited)
    env.reset(seed=0)
    rewards, truncated = [], False
    while not truncated:
        env.unwrapped.episodes.env.metrics.ever[:] = True
        _, reward, _, truncated, _ = env.step(REST)
        rewards.append(reward)
    assert rewards == [0, 0, 0, 1]


def test_the_clock_of_long_episodes_goes_on():
    env = TaskEnv("sit-chair", time_limit=1800.0)
    env.reset(seed=0)
    env.episodes.env.steps += round(1500 / CONTROL_DT)
    seen, *_ = env.step(REST)
    assert seen["time"][0] == pytest.approx(1500.02) and seen in env.observation_space


def test_a_policy_that_writes_into_what_it_observes_changes_nothing_else():
    env = TaskEnv("sit-chair", split="all")
    env.reset(seed=0)
    env.step(REST)
    names = ("joint_pos", "joint_vel", "root_ang_vel", "root_height", "time", "last_target", "last_action", "proprio")
    world = env.episodes.env
    expected = {name: value.clone() for name, value in world.observe(names).items()}
    spoiled = world.observe(names)
    for name in names[:-1]:
        spoiled[name].mul_(0.0).add_(7.0)
    assert (spoiled["proprio"] == expected["proprio"]).all()
    again = world.observe(names)
    assert all((again[name] == expected[name]).all() for name in names)
