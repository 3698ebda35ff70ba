import subprocess
import sys
import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

import making
import mimicbench
import stool
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, BadObject, MimicbenchError, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import rng
from mimicbench.drawing.opengl import NoPictures
from mimicbench.envs.gym import TaskEnv
from mimicbench.envs.gym_vector import TaskVectorEnv
from mimicbench.envs.initial_states import clipped, start_of
from mimicbench.envs.nearness import nearness
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.rule_starts import Stance, Starts, draw_start
from mimicbench.objects.registry import FAMILIES, make_object
from mimicbench.objects.shape import save_object, split_of
from mimicbench.objects.touch import STAND_OFF
from mimicbench.sensors.rays import FARTHEST
from mimicbench.sensors.render import FLOOR, NOTHING, OBJECT, ROBOT
from mimicbench.tasks.registry import TASKS
from stool import H1, JOINT, block, seated

READY = [name for name, slug in mimicbench.ENVIRONMENTS.items() if TASKS.get(slug).family in FAMILIES]
every_task = pytest.mark.parametrize("name", READY)
REST = np.array(H1.rest_pose, np.float32)


def make(name="SitChair", pool=20, **arguments):
    return gymnasium.make(f"mimicbench/{name}-v0", split="test", pool=pool, **arguments).unwrapped


def make_vec(name="SitChair", num_envs=3, **arguments):
    return gymnasium.make_vec(f"mimicbench/{name}-v0", num_envs=num_envs, split="test", pool=20, **arguments)


def in_python(script):
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_an_environment_for_every_task():
    assert list(mimicbench.ENVIRONMENTS.values()) == list(TASKS)
    for name in mimicbench.ENVIRONMENTS:
        assert f"mimicbench/{name}-v0" in gymnasium.registry


@pytest.mark.parametrize("order", ["import mimicbench, gymnasium", "import gymnasium, mimicbench"])
def test_importing_registers_whatever_comes_first(order):
    assert in_python(f"{order}; print(sum(name.startswith('mimicbench/') for name in gymnasium.registry))") == "6"


def test_gymnasium_imports_it_when_asked():
    assert "TaskEnv" in in_python("import gymnasium; print(gymnasium.make('mimicbench:mimicbench/SitChair-v0'))")


def test_importing_mimicbench_imports_nothing_else():
    out = in_python(
        "import mimicbench, sys; print({'gymnasium', 'numpy', 'typing'} & set(sys.modules) - "
        "set(sys.stdlib_module_names))"
    )
    assert out == "set()"


@every_task
def test_the_contract_of_single_environments(name):
    env = make(name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True)
    # the robot's limits are what they are; gymnasium.wrappers.RescaleAction is for those who want -1..1
    assert [str(w.message) for w in caught if "symmetric and normalized" not in str(w.message)] == []
    assert env.observation_space["proprio"].shape == (48,)
    assert env.observation_space["state"].shape == (300,)
    assert env.metadata["render_fps"] == 50
    _, info = env.reset(seed=0)
    assert {name: type(value) for name, value in info.items()} == {
        "success": bool,
        "is_success": bool,
        "stays": bool,
        "effort": float,
        "fell": bool,
        "diverged": bool,
        "start": int,
        "seed": int,
    }


@every_task
@pytest.mark.parametrize("mode", list(AutoresetMode)[:2])
def test_a_vector_is_its_single_environments(name, mode):
    """Gymnasium's own loop over single environments gives the same bits, at every end of an episode too."""
    ours = make_vec(name, autoreset_mode=mode, time_limit=0.06)
    loop = make_vec(name, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, time_limit=0.06)
    assert ours.metadata["autoreset_mode"] is mode
    assert ours.action_space == loop.action_space and ours.observation_space == loop.observation_space
    assert data_equivalence(ours.reset(seed=5), loop.reset(seed=5), exact=True)
    ours.action_space.seed(0)
    for step in range(5):
        action = ours.action_space.sample()
        (seen, *results, info), (loop_seen, *loop_results, loop_info) = ours.step(action), loop.step(action)
        assert seen in ours.observation_space
        assert data_equivalence(seen, loop_seen, exact=True), step
        assert data_equivalence(tuple(results), tuple(loop_results), exact=True), step
        assert data_equivalence(info, loop_info, exact=True), step


@every_task
def test_threads_change_nothing(name):
    one, two = make_vec(name, 4, workers=1), make_vec(name, 4, workers=2)
    assert data_equivalence(one.reset(seed=1), two.reset(seed=1), exact=True)
    one.action_space.seed(1)
    for _ in range(10):
        action = one.action_space.sample()
        assert data_equivalence(one.step(action), two.step(action), exact=True)


def test_a_seed_is_an_episode():
    env, other = make(), make()
    env.reset(seed=8)
    seen, info = env.reset()
    again, info_again = other.reset(seed=info["seed"])
    assert data_equivalence((seen, info), (again, info_again), exact=True)


def test_a_fresh_object_at_every_reset():
    env = make(pool=60)
    ids = [env.reset(seed=0 if i == 0 else None) and env.object_ids()[0] for i in range(12)]
    assert len(set(ids)) > 3
    assert {split_of(object_id) for object_id in ids} == {"test"}
    assert [obj.id for obj in env.episodes.env.physics.objects] == ids[-1:]


def test_next_step_restarts_leave_the_others_alone():
    envs = make_vec(num_envs=2, time_limit=0.04)
    envs.reset(seed=3)
    envs.reset(options={"reset_mask": np.array([False, True])})
    action = np.tile(REST, (2, 1))
    assert not envs.step(action)[3].any()
    envs.reset(options={"reset_mask": np.array([False, True])})
    assert envs.step(action)[3].tolist() == [True, False]
    before = envs.episodes.seeds.copy()
    seen, reward, terminated, truncated, _ = envs.step(action)
    assert truncated.tolist() == [False, True] and not terminated.any() and not reward.any()
    assert seen["time"][:, 0].tolist() == pytest.approx([0.0, 0.04])
    assert (envs.episodes.seeds != before).tolist() == [True, False]


def test_disabled_restarts_wait_for_reset():
    envs = make_vec(num_envs=2, time_limit=0.02, autoreset_mode="Disabled")
    envs.reset(seed=3)
    assert envs.step(np.tile(REST, (2, 1)))[3].all()
    with pytest.raises(MimicbenchError, match="reset_mask"):
        envs.step(np.tile(REST, (2, 1)))
    envs.reset(options={"reset_mask": np.ones(2, bool)})
    envs.step(np.tile(REST, (2, 1)))


def test_sitting_is_rewarded_once_and_ends_the_episode():
    env = make(objects=[block(0.42)])
    env.reset(seed=0)
    pos, joints = seated(0.42)
    stool.put(env.episodes.env.physics, np.zeros(1, int), pos[None], rot.IDENTITY[None], joints[None])
    total = 0.0
    for _ in range(100):
        _, reward, terminated, truncated, info = env.step(joints.astype(np.float32))
        total += reward
        assert info["success"] == terminated and not truncated
        if terminated:
            break
    assert total == 1.0 and env.episodes.metrics.steps[0] == 15  # 0.3 s at 50 Hz
    assert info["effort"] >= 0 and not info["fell"]


def test_lift_box_ends_at_the_limit_and_only_its_last_frame_counts():
    env = make("LiftBox", time_limit=0.1)
    env.reset(seed=0)
    qpos, obj, turned = env.episodes.env.physics.qpos()[0], env.episodes.starts[0].obj, rot.from_yaw(np.array(np.pi))
    wrist = H1.keypoint_pos("left_wrist", *H1.forward_kinematics(qpos[:3] * [0, 0, 1], turned, REST))
    rewards = []
    for _ in range(5):
        # held up just before the wrists by nothing but this test
        qpos[:3], qpos[3:7], qpos[7:26] = qpos[:3] * [0, 0, 1], turned, REST
        qpos[26:29] = wrist[0] - 0.06 - obj.bounds()[1][0], 0.0, 0.35
        env.episodes.env.physics.qvel()[0] = 0.0
        _, reward, terminated, truncated, info = env.step(REST)
        rewards.append(reward)
        assert not terminated
    assert truncated and info["success"]
    assert rewards == [0, 0, 0, 0, 1]


def test_broken_physics_end_one_episode_and_not_the_others():
    envs = make_vec()
    envs.reset(seed=0)
    envs.episodes.env.physics.qpos()[1, 8] = np.nan
    seen, reward, terminated, truncated, info = envs.step(np.tile(REST, (3, 1)))
    assert terminated.tolist() == info["diverged"].tolist() == [False, True, False]
    assert not truncated.any() and not reward.any() and not info["success"].any()
    assert seen in envs.observation_space
    seen, _, terminated, _, info = envs.step(np.tile(REST, (3, 1)))
    assert not terminated.any() and not info["diverged"].any()
    assert seen["time"][1] == 0.0


@pytest.mark.parametrize("control", ["position", "velocity", "torque"])
def test_actions_are_the_robots_limits(control):
    env = make(control=control)
    low, high = {
        "position": H1.joint_range.T,
        "velocity": (-H1.velocity_limit, H1.velocity_limit),
        "torque": np.array([[-joint.torque_limit, joint.torque_limit] for joint in H1.joints]).T,
    }[control]
    np.testing.assert_allclose(env.action_space.low, low, rtol=1e-6)
    np.testing.assert_allclose(env.action_space.high, high, rtol=1e-6)
    env.reset(seed=0)
    action = np.zeros(19, np.float32)
    knee = JOINT["left_knee"]
    action[knee] = 1.0 if control == "position" else 0.5 * high[knee]
    before = env.episodes.env.physics.qpos()[0, 7 + knee]
    seen = env.step(action)[0]
    assert env.episodes.env.physics.qpos()[0, 7 + knee] > before
    np.testing.assert_array_equal(seen["state"][-22:-3], action)  # the last action is sensed


def test_targets_are_where_the_wrists_are_to_go():
    if "household" not in FAMILIES:
        pytest.skip("no household objects yet")
    env = make("TouchPoints", observe=("proprio", "elevation"))
    seen, _ = env.reset(seed=1)
    start = env.episodes.starts[0]
    world = start.root_pos_w + rot.rotate(start.root_quat_w, seen["targets"].astype(float))
    np.testing.assert_allclose(world, start.wrist_goal_w, atol=1e-5)
    assert start.wrist_goal_w[0, 1] < start.wrist_goal_w[1, 1]  # facing -x, the left hand has the smaller y
    # cells of 1 cm, and both targets in the map at their heights
    marked = np.sort(seen["target_elevation"][seen["target_elevation"] > -start.root_pos_w[2] + 1e-4])
    np.testing.assert_allclose(marked, np.sort(start.wrist_goal_w[:, 2] - start.root_pos_w[2]), atol=1e-5)


def test_a_hand_without_a_goal_is_told_to_stay():
    env = make("TouchPoints", observe=("proprio",))
    env.reset(seed=1)
    env.episodes.env.wrist_goal_w[0, 1] = torch.nan
    seen = env.step(np.zeros(19, np.float32))[0]
    physics = env.episodes.env.physics
    qpos, links = physics.qpos()[0], physics.links()
    pos, quat = links.pos_w.cpu().numpy()[0], links.quat_w.cpu().numpy()[0]
    told = qpos[:3] + rot.rotate(qpos[3:7], seen["targets"].astype(float))
    wrist = env.episodes.robot.keypoint_pos("right_wrist", pos, quat)
    np.testing.assert_allclose(told[1], wrist, atol=1e-5)
    np.testing.assert_allclose(told[0], env.episodes.env.wrist_goal_w[0, 0], atol=1e-5)


def test_the_elevation_map_shows_the_object():
    env = make(observe=("elevation",))
    seen, _ = env.reset(seed=0)
    assert list(seen) == ["elevation"] and seen["elevation"].shape == (128, 128)
    start = env.episodes.starts[0]
    assert seen["elevation"].max() == pytest.approx(start.obj.bounds()[1][2] - start.root_pos_w[2], abs=0.05)


@pytest.mark.parametrize("slug", [TASKS.get(mimicbench.ENVIRONMENTS[name]).name for name in READY])
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_starts_by_rule(slug, seed):
    task = TASKS.get(slug)
    start = draw_start(task, make_object(f"{task.family}-0-{seed % 40:05d}"), Stance.of(H1), rng(seed))
    links = H1.forward_kinematics(start.root_pos_w, start.root_quat_w, start.joint_pos)
    for side in ("left", "right"):
        assert H1.keypoint_pos(f"{side}_sole", *links)[2] == pytest.approx(0.005, abs=0.01)
    assert start.obj.distance(links[0]).min() > 0.05
    ankles = np.mean([H1.keypoint_pos(f"{side}_ankle", *links)[:2] for side in ("left", "right")], 0)
    heading = rot.rotate(start.root_quat_w, np.array([1.0, 0.0, 0.0]))
    if task.max_start_distance is None:
        assert 0 <= ankles[0] - start.obj.bounds()[1][0] - STAND_OFF <= 0.3
        assert heading[0] < -0.97
    else:
        assert 1.0 <= np.linalg.norm(ankles) <= 2.0
        low, high = start.obj.bounds()
        assert np.max(np.maximum(low[:2] - ankles, ankles - high[:2])) >= 0.45 - 1e-9


def clip(frames=60, object_id="chair-0-00001", far=3.0):
    """A robot that drifts and turns, far from its object."""
    time = np.linspace(0, 1, frames)
    pos = np.stack([far + 0.1 * time, 1.0 + 0.3 * np.sin(2 * time), 1.0 + 0.05 * time], -1)
    quat = rot.multiply(rot.from_yaw(1.3 * time - 2), rot.from_rotvec(np.stack([0.2 * time, 0 * time, 0 * time], -1)))
    quat[frames // 3 :] *= -1
    joints = REST + 0.3 * np.sin(3 * time)[:, None] * np.linspace(-1, 1, 19)
    return RobotMotion(
        f"clip-{object_id}",
        "sit-chair",
        "h1",
        H1.joint_names,
        (frames - 1) / 1.0,
        pos,
        quat,
        joints,
        object_id,
        "human",
    )


@pytest.mark.parametrize("frames", [60, 45, 12])
def test_a_motion_starts_as_trackers_start_it(frames):
    motion, task = clip(frames), TASKS.get("sit-chair")
    start = start_of(motion, make_object(motion.object_id), H1, task)
    first = ReferenceBank([motion], H1).frame(torch.tensor([0]), torch.tensor([0]))
    names = ("root_pos_w", "root_quat_w", "root_lin_vel_w", "root_ang_vel_w", "joint_pos", "joint_vel")
    pos, quat, lin_vel_w, spin_w, joint_pos, joint_vel = (
        getattr(first, name)[0].numpy().astype(float) for name in names
    )
    np.testing.assert_allclose(start.root_pos_w, [*(pos[:2] * 2 / np.linalg.norm(pos[:2])), pos[2]], atol=1e-12)
    np.testing.assert_allclose(start.root_quat_w, rot.normalize(quat), atol=1e-12)
    np.testing.assert_array_equal(start.joint_pos, joint_pos)
    for ours, theirs in (
        (start.root_lin_vel_w, lin_vel_w),
        (start.root_ang_vel_b, rot.rotate_inverse(rot.normalize(quat), spin_w)),
        (start.joint_vel, joint_vel),
    ):
        np.testing.assert_allclose(ours, theirs, atol=2e-4 if frames < 60 else 1e-6)
    assert start.reference_id == motion.id


def test_positions_are_clipped_on_the_way_to_the_origin():
    np.testing.assert_allclose(clipped(np.array([3.0, 4.0, 1.0]), 2.0), [1.2, 1.6, 1.0])
    np.testing.assert_allclose(clipped(np.array([0.3, 0.4, 1.0]), 2.0), [0.3, 0.4, 1.0])
    np.testing.assert_allclose(clipped(np.array([3.0, 4.0, 1.0]), None), [3.0, 4.0, 1.0])


def test_starts_from_motions_of_the_split_only():
    ids = [f"chair-0-{index:05d}" for index in range(8)]
    env = gymnasium.make(
        "mimicbench/SitChair-v0", split="test", starts=[clip(object_id=object_id) for object_id in ids]
    ).unwrapped
    met = [env.reset(seed=seed) and (env.object_ids()[0], env.reference_ids()[0]) for seed in range(10)]
    assert {object_id for object_id, _ in met} == {object_id for object_id in ids if split_of(object_id) == "test"}
    assert all(reference_id == f"clip-{object_id}" for object_id, reference_id in met)


def test_a_start_has_the_number_that_it_was_given_with_whatever_the_split():
    ids = [f"chair-0-{index:05d}" for index in range(8)]
    places = [place for place, object_id in enumerate(ids) if split_of(object_id) == "train"]
    other = next(place for place in range(8) if place not in places)
    env = TaskEnv("sit-chair", split="train", starts=[clip(object_id=object_id) for object_id in ids])
    for place in places:
        _, info = env.reset(seed=0, options={"start": place})
        assert (env.object_ids(), info["start"]) == ([ids[place]], place)
    with pytest.raises(MimicbenchError, match=f"start {other} is beside an object of another split; give another"):
        env.reset(seed=0, options={"start": other})
    for seed in range(5):
        _, info = env.reset(seed=seed)
        assert [ids[info["start"]]] == env.object_ids()


def test_who_lifts_is_given_something_that_can_be_moved():
    with pytest.raises(BadObject, match="chair-0-00001 is fixed, and lift-box moves its own"):
        TaskEnv("lift-box", objects=["chair-0-00001"]).reset(seed=0)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pool": 2.5}, "pool=2.5; give a whole number"),
        ({"pool": "3"}, "pool='3'; give a whole number"),
        ({"max_episode_steps": 2.5}, "max_episode_steps=2.5; give a whole number"),
        ({"time_limit": "5"}, "time_limit='5'; give seconds"),
        ({"observe": None}, "observe=None; give names of observations"),
        ({"cameras": (90.5, 120)}, "rows and columns, not 90.5 x 120"),
    ],
)
def test_numbers_that_are_none_are_told_in_a_sentence(given, said):
    with pytest.raises(MimicbenchError, match=said):
        TaskEnv("sit-chair", **given)


def test_starts_from_a_work_folder(tmp_path):
    with pytest.raises(BadMotion, match="mimicbench retarget"):
        make(starts=tmp_path)
    obj = replace(block(0.4), id="own-chair")  # an object that no family makes
    objects = tmp_path / "sit-chair" / "objects" / "own"
    save_object(objects, obj)
    folder = tmp_path / "sit-chair" / "retarget" / "one"
    with making.by_hand(folder, "retarget", reads={"objects": objects}) as stage:
        clip(object_id=obj.id).save(stage.folder / "clip.npz")
        stage.finish()
    with pytest.raises(BadMotion, match="split"):
        TaskEnv("sit-chair", split="train" if obj.split == "test" else "test", starts=tmp_path)
    env = TaskEnv("sit-chair", split=obj.split, starts=str(tmp_path))
    env.reset(seed=0)
    assert (env.object_ids(), env.reference_ids()) == (["own-chair"], ["clip-own-chair"])
    env = TaskEnv("sit-chair", split=obj.split, starts=folder)
    assert env.reset(seed=0) and env.object_ids() == ["own-chair"]
    with making.by_hand(folder.with_name("two"), "retarget", settings={"other": 1}):
        pass
    with pytest.raises(BadMotion, match="several stages"):
        TaskEnv("sit-chair", split=obj.split, starts=tmp_path)


def test_mistakes_are_told():
    for arguments in ({"observe": ("smell",)}, {"control": "thought"}, {"colour": "red"}, {"render_mode": "ansi"}):
        with pytest.raises(UnknownName):
            TaskEnv("sit-chair", **arguments)
    with pytest.raises(UnknownName):
        TaskEnv("sit-chair", split="validation")
    with pytest.raises(UnknownName):
        TaskVectorEnv("sit-chair", 2, autoreset_mode="Never")
    with pytest.raises(MimicbenchError, match="time limit"):
        TaskEnv("sit-chair", time_limit=-1.0)
    with pytest.raises(MimicbenchError, match="at least 1"):
        TaskVectorEnv("sit-chair", 0)
    with pytest.raises(BadObject, match="larger pool"):
        Starts(TASKS.get("sit-chair"), H1, "test", None, 1, None)  # chair-0-00000 is one to train with
    env = TaskEnv("sit-chair")
    with pytest.raises(MimicbenchError, match="call reset"):
        env.step(REST)
    env.reset(seed=0)
    for bad in (np.full(19, np.nan), np.zeros(7)):
        with pytest.raises(MimicbenchError, match="finite numbers"):
            env.step(bad)
    for bad in (1 << 80, -1, 0.5, "one"):
        with pytest.raises(MimicbenchError, match="is no seed"):
            env.reset(seed=bad)
    with pytest.raises(UnknownName, match="option of reset 'goal'"):
        env.reset(options={"goal": 1})
    with pytest.raises(MimicbenchError, match="there is no start 5000"):
        env.reset(options={"start": 5000})
    for bad in (0.5, np.nan, "x", [1], np.array([1, 2])):
        with pytest.raises(MimicbenchError, match="there is no start"):
            env.reset(options={"start": bad})
    assert env.reset(seed=np.int64(3))[1]["seed"] == 3
    for arguments, told in (
        ({"reward": "huge"}, "unknown reward"),
        ({"action": "wish"}, "unknown action"),
        ({"action": "residual", "control": "torque"}, "torque control"),
        ({"max_episode_steps": 0}, "1 or more"),
        ({"workers": -1}, "workers=-1; give 1 to 4096, or 0"),
        ({"workers": "all"}, "workers='all'; give 1 to 4096"),
        ({"cameras": (90,)}, "their height and width"),
    ):
        with pytest.raises(MimicbenchError, match=told):
            TaskEnv("sit-chair", **arguments)
    envs = TaskVectorEnv("sit-chair", 2, render_mode="rgb_array")
    for unbegun in (envs, TaskEnv("sit-chair", render_mode="rgb_array")):
        with pytest.raises(MimicbenchError, match="call reset"):
            unbegun.render()
    for bad in (1 << 80, [1, -2]):
        with pytest.raises(MimicbenchError, match="is no seed"):
            envs.reset(seed=bad)
    with pytest.raises(UnknownName, match="reset_mask"):
        envs.reset(options={"mask": np.ones(2, bool)})
    with pytest.raises(MimicbenchError, match="start must hold 2"):
        envs.reset(options={"start": np.zeros(3, int)})
    with pytest.raises(MimicbenchError, match="seeds"):
        envs.reset(seed=[1])
    with pytest.raises(MimicbenchError, match="all environments"):
        envs.reset(options={"reset_mask": np.array([True, False])})


def test_time_limits_are_gymnasiums_too():
    for name, steps in mimicbench.EPISODE_STEPS.items():
        assert steps == round(TASKS.get(mimicbench.ENVIRONMENTS[name]).time_limit / 0.02)
        assert gymnasium.spec(f"mimicbench/{name}-v0").max_episode_steps == steps
    env = gymnasium.make("mimicbench/SitChair-v0", pool=20)
    assert env.spec.max_episode_steps == 1000
    single = gymnasium.make("mimicbench/SitChair-v0", pool=20, max_episode_steps=3)
    envs, shorter = make_vec(max_episode_steps=3), make_vec(max_episode_steps=30, time_limit=0.06)
    loop = make_vec(vectorization_mode="sync", max_episode_steps=3)
    for each in (single, envs, shorter, loop):
        each.reset(seed=0)
        action = np.broadcast_to(REST, each.action_space.shape)
        ended = [bool(np.all(each.step(action)[3])) for _ in range(3)]
        assert ended == [False, False, True]
    assert envs.spec.max_episode_steps == 1000 and envs.spec.kwargs["max_episode_steps"] == 3


def test_spaces_know_nothing_of_the_time_limit():
    short, long = make(time_limit=0.1), make(time_limit=15.0)
    assert short.observation_space == long.observation_space and short.action_space == long.action_space


def test_one_observation_may_be_named_alone():
    assert list(make(observe="proprio").reset(seed=0)[0]) == ["proprio"]
    with pytest.raises(MimicbenchError, match="nothing is observed; name at least one term"):
        make(observe=())
    with pytest.raises(MimicbenchError, match="cameras=90 is no size"):
        make(observe="depth", cameras=90)


def test_one_object_may_be_named_alone():
    alone, one = (make(objects=given).reset(seed=0)[0]["state"] for given in ("chair-0-00004", ["chair-0-00004"]))
    assert np.array_equal(alone, one)


def test_vector_infos_are_numbers():
    envs = make_vec(autoreset_mode="SameStep", time_limit=0.02)
    _, info = envs.reset(seed=0)
    _, _, _, _, later = envs.step(np.tile(REST, (3, 1)))
    for facts in (info, later["final_info"], {name: value for name, value in later.items() if "final" not in name}):
        assert all(values.dtype.kind in "bif" and values.shape == (3,) for values in facts.values())


def test_vectors_become_torch_tensors():
    pytest.importorskip("array_api_compat", reason="Gymnasium's NumpyToTorch needs array-api-compat")
    from gymnasium.wrappers.vector import NumpyToTorch

    for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED):  # Gymnasium itself puts dicts into final_obs
        envs = NumpyToTorch(make_vec(autoreset_mode=mode, time_limit=0.04))
        _, info = envs.reset(seed=0)
        assert isinstance(info["start"], torch.Tensor)
        for _ in range(1 if mode is AutoresetMode.DISABLED else 3):
            seen, reward, *_, info = envs.step(torch.tensor(REST).expand(3, -1))
            assert isinstance(seen["proprio"], torch.Tensor) and isinstance(info["seed"], torch.Tensor)
            assert isinstance(reward, torch.Tensor)


def test_a_start_can_be_chosen():
    ids = ["chair-0-00003", "chair-0-00001", "chair-0-00007"]
    motions = [clip(object_id=object_id) for object_id in ids]
    envs = TaskVectorEnv("sit-chair", 3, split="all", starts=motions)
    _, info = envs.reset(seed=0, options={"start": np.array([2, 0, 2])})
    assert info["start"].tolist() == [2, 0, 2]
    assert envs.object_ids() == [ids[2], ids[0], ids[2]] and envs.reference_ids()[1] == motions[0].id
    mask = np.array([False, True, False])
    envs.reset(options={"start": np.array([0, 1, 1]), "reset_mask": mask})
    assert envs.object_ids() == [ids[2], ids[1], ids[2]]
    env = make(objects=[block(0.42), block(0.5)])
    assert [env.reset(seed=4, options={"start": k})[1]["start"] for k in (1, 0)] == [1, 0]
    assert env.object_ids() == [block(0.42).id]


def test_residual_actions_are_around_the_rest_pose():
    env, plain = make(action="residual"), make()
    assert env.action_space == gymnasium.spaces.Box(-1.0, 1.0, (19,), np.float32)
    action = np.linspace(-0.3, 0.3, 19, dtype=np.float32)
    for each in (env, plain):
        each.reset(seed=0)
    np.testing.assert_array_equal(env.step(action)[0]["state"], plain.step(action + REST)[0]["state"])
    assert torch.equal(env.episodes.env.last_action[0], torch.from_numpy(action))


def test_dense_reward_by_hand():
    env = make(objects=[block(0.42)], reward="dense")
    env.reset(seed=0)
    pos, joints = seated(0.42)
    steps = ((0.0, 1.0), (0.5, np.exp(-0.25)), (1.25, np.exp(-1.0)))  # the stool's edge is 0.25 m from its middle
    for away, expected in steps:
        stool.put(
            env.episodes.env.physics, np.zeros(1, int), pos[None] + [away, 0, 0], rot.IDENTITY[None], joints[None]
        )
        env.episodes.env._context = env.episodes.env._look()
        assert nearness(env.episodes.env)[0] == pytest.approx(expected, abs=1e-6)
    env.episodes.metrics.fell[:] = True
    assert nearness(env.episodes.env)[0] == 0.0


@every_task
def test_dense_rewards_are_from_0_to_1_and_episodes_go_on(name):
    envs = make_vec(name, reward="dense", time_limit=0.2, autoreset_mode="Disabled")
    envs.reset(seed=0)
    envs.episodes.metrics.ever[:] = True  # as if K had been fulfilled
    action = np.tile(REST, (3, 1))
    rewards = []
    for step in range(10):
        _, reward, terminated, truncated, info = envs.step(action)
        rewards.append(reward)
        assert not terminated.any() and truncated.all() == (step == 9)
        assert info["is_success"].tolist() == info["success"].tolist()
    assert np.min(rewards) > 0 and np.max(rewards) <= 1


_DRAWN_THEN_FORKED = """
import os
import mimicbench
from mimicbench.envs.gym import TaskEnv
from mimicbench.drawing.opengl import NoPictures

def look():
    env = TaskEnv("sit-chair", observe="color", cameras=(20, 30), split="test", pool=20)
    env.reset(seed=0)
    env.close()

try:
    look()
except NoPictures as error:
    print("none", error)
    raise SystemExit(0)
if os.fork() == 0:
    try:
        look()
    except NoPictures as error:
        print(error, flush=True)
    os._exit(0)
os.wait()
"""


def test_a_fork_of_who_has_drawn_is_told():
    told = in_python(_DRAWN_THEN_FORKED)
    if told.startswith("none"):
        pytest.skip(told)
    assert "forked" in told and "spawn" in told


_DRAWN_AND_LEFT_OPEN = """
import gymnasium, mimicbench
from mimicbench.drawing.opengl import NoPictures

env = gymnasium.make("mimicbench/SitChair-v0", render_mode="rgb_array", height=60, width=80)
env.reset(seed=0)
try:
    print(env.render().shape)
except NoPictures as error:
    print("none", error)
"""


def test_who_forgets_to_close_is_told_nothing():
    done = subprocess.run([sys.executable, "-c", _DRAWN_AND_LEFT_OPEN], capture_output=True, text=True)
    if done.stdout.startswith("none"):
        pytest.skip(done.stdout)
    assert (done.stdout.strip(), done.stderr, done.returncode) == ("(60, 80, 3)", "", 0)


def test_pictures():
    envs = make_vec(num_envs=2, render_mode="rgb_array", height=64, width=96)
    envs.reset(seed=0)
    try:
        first, second = envs.render()
    except NoPictures as error:
        pytest.skip(f"no OpenGL: {error}")
    assert first.shape == (64, 96, 3) and first.dtype == np.uint8
    assert not np.array_equal(first, second) and first.std() > 10
    envs.close()
    env = make(render_mode="rgb_array", height=64, width=96)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.render(), first)
    env.close()


@pytest.mark.parametrize("name", ["SitChair", "TouchPoints", "LiftBox"])
def test_cameras_see_the_scene(name):
    sees = {"observe": ("depth", "color", "labels"), "cameras": (45, 60)}
    env, envs = make(name, **sees), make_vec(name, **sees)
    try:
        seen, _ = env.reset(seed=0)
    except NoPictures as error:
        pytest.skip(f"no OpenGL: {error}")
    count = len(TASKS.get(mimicbench.ENVIRONMENTS[name]).rig.mounts)
    assert seen["depth"].shape == seen["labels"].shape == (count, 45, 60) and seen["color"].shape == (count, 45, 60, 3)
    assert env.observation_space.contains(seen)
    labels, depth = seen["labels"], seen["depth"]
    assert (labels == FLOOR).mean() > 0.1 and (labels == OBJECT).sum() > 20 and (labels >= ROBOT).any()
    # what is drawn and what the rays meet are the same, but for some edges
    assert (depth[labels == NOTHING] < FARTHEST).sum() <= 0.05 * (labels == NOTHING).sum()
    assert np.median(depth[labels == OBJECT]) < 5.0
    red = (seen["color"] == (255, 0, 0)).all(-1).sum()
    assert red == (2 if name == "TouchPoints" else 0)
    stacked, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(stacked)
    for sense, values in seen.items():
        np.testing.assert_array_equal(stacked[sense][0], values)
    assert not np.array_equal(stacked["color"][0], stacked["color"][1])
    again = env.step(env.action_space.sample())[0]
    assert env.observation_space.contains(again)
    env.close()
    envs.close()


def test_depth_needs_no_opengl(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    env = make(observe=("depth",), cameras=(20, 30))
    assert env.reset(seed=0)[0]["depth"].shape == (4, 20, 30)
    env = make(observe=("color",))
    with pytest.raises(NoPictures, match="no OpenGL"):
        env.reset(seed=0)
