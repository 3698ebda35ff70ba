"""What learns from demonstrations, and stages from clips to policies, where objects move and where goals are told."""

from dataclasses import replace

import imageio.v3 as iio
import numpy as np
import pyarrow.parquet as pq
import pytest
import torch

import making
from learning import ONE, ROBOT, clip_of, shape_of, tracker
from mimicbench.benchmark import run_stage
from mimicbench.benchmark.graph import start
from mimicbench.benchmark.judging import judge
from mimicbench.benchmark.recipe import EvaluateConfig
from mimicbench.benchmark.who import who_of
from mimicbench.core.errors import BadFile
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.initial_states import stacked, start_of
from mimicbench.envs.lerobot.seen import make_one
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import VecEnv
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate import cloning
from mimicbench.imitate.clock import clock_features
from mimicbench.imitate.dataset import DemoFrames
from mimicbench.imitate.demos import demonstrations, scene_names, scene_terms
from mimicbench.imitate.goals import GivenGoal
from mimicbench.imitate.learners.bc import BCImitation
from mimicbench.imitate.learners.bc_clock import BCClockImitation
from mimicbench.imitate.learners.planner import PlannerConfig, PlannerImitation
from mimicbench.imitate.lerobot import Demos, load_demos
from mimicbench.imitate.perception import Perception, save_perception
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.inputs import InputConfig, Window
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.imitate.spec import Given
from mimicbench.imitate.stored.demo_writer import Demonstration, DemoWriter
from mimicbench.imitate.stored.scenery import Scenery
from mimicbench.imitate.stored.verify import replayed, unfulfilled
from mimicbench.objects.registry import make_object
from mimicbench.policies.loading import load_policy
from mimicbench.retarget.settings import RetargetConfig
from mimicbench.sensors.scene import PICTURE
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from mimicbench.track.learning.ppo import PPOConfig
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.settings import TrackConfig

OTHERS = ("lift-box", "touch-points")


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory):
    """Clips of a task, and where demonstrations of them are, all of which count as successes."""
    made = {}

    def of(name):
        if name not in made:
            clips, folder = clip_of(TASKS.get(name)), tmp_path_factory.mktemp(name)
            follower = tracker(shape_of("residual", *TASKS.all()))
            shown = (*scene_terms(clips.task), PICTURE)
            rollout = track_clips(follower, clips, RolloutConfig(record=True, settle=0.1, observe=shown), ONE)
            done = torch.ones_like(rollout.verdict.success)
            rollout = replace(rollout, verdict=replace(rollout.verdict, success=done, stays=done))
            writer = DemoWriter(folder, ROBOT.name, clips.task.title, ROBOT.joint_names)
            for demo in demonstrations(rollout, clips, 0):
                writer.add(demo)
            writer.finish()
            made[name] = clips, folder
        return made[name]

    return of


@pytest.mark.parametrize("name", list(TASKS))
def test_k_is_found_again_in_stored_states(name, tmp_path):
    """Of demonstrations that do what their clip does; not of one whose robot, or box, is elsewhere in the end."""
    clips = clip_of(TASKS.get(name))
    (motion,) = clips.motions
    motion = motion.resampled(1 / CONTROL_DT)
    robot = [motion.root_pos_w, motion.root_quat_w, motion.joint_pos]
    box = [motion.object_pos_w, motion.object_quat_w] if len(motion.object_pos_w) else []
    qpos = np.concatenate(robot + box, 1)
    qpos = np.concatenate([qpos, np.repeat(qpos[-1:], 50, 0)])
    wrong = qpos.copy()
    wrong[-1, -7 if box else 0] += 3.0
    writer = DemoWriter(tmp_path, ROBOT.name, clips.task.title, ROBOT.joint_names)
    for states in (qpos, wrong):
        still = np.zeros((len(states), len(ROBOT.joints)))
        state = np.zeros((len(states), 300))
        writer.add(Demonstration(state, still, still, states, states[:, 1:], motion.object_id, motion.id, True))
    writer.finish()
    demos = load_demos(tmp_path, ROBOT.name, state=False)
    assert unfulfilled(demos, clips) == [motion.id]
    np.testing.assert_allclose(replayed(demos, 0, motion).joint_pos[: motion.frames], motion.joint_pos, atol=1e-6)
    with pytest.raises(BadFile, match="is missing"):
        unfulfilled(demos, replace(clips, motions=[]))


@pytest.mark.parametrize("name", OTHERS)
def test_demonstrations_hold_what_lerobots_environments_show(name, demonstrated):
    """Beside the same state: numbers of body and object, each with a name, and the picture."""
    clips, folder = demonstrated(name)
    env = make_one(name, split="all", images=True, starts=clips.motions, objects=list(clips.objects.values()))
    seen, _ = env.reset(options={"start": 0})
    table = pq.read_table(folder / "data/chunk-000/file-000.parquet").slice(0, 1).to_pylist()[0]
    episodes = env.unwrapped.episodes
    np.testing.assert_allclose(episodes.qpos()[0], table["sim.qpos"], atol=1e-5)
    np.testing.assert_allclose(seen["agent_pos"], table["observation.state"], atol=1e-4)
    np.testing.assert_allclose(seen["environment_state"], table["observation.environment_state"], atol=1e-4)
    assert len(scene_names(clips.task)) == len(seen["environment_state"])
    picture = iio.imread(table["observation.images.elevation"]["bytes"]).astype(int)
    assert np.abs(picture - seen["pixels"]["elevation"]).mean() < 0.5, "but for cells that rays just miss"
    env.close()


def test_the_papers_clone_sees_what_it_is_told(demonstrated, tmp_path):
    clips, folder = demonstrated("touch-points")
    config = BCImitation(train=TrainConfig(steps=2, batch=8))
    cloning.clone(tmp_path / "policy", Given(clips, folder, 0, "improved", making.QUIET), config)
    policy = load_policy(tmp_path / "policy", ROBOT, clips.task)
    assert {"elevation", "target_elevation"} <= set(policy.observations) and policy.learner.inputs.channels == 2
    assert not run_policy(policy, replace(clips, task=replace(clips.task, time_limit=0.1)), env_config=ONE)[0].errors


@pytest.mark.parametrize("name", OTHERS)
def test_a_clone_knows_its_goal(name, demonstrated, tmp_path):
    clips, folder = demonstrated(name)
    config = BCClockImitation(train=TrainConfig(steps=2, batch=8))
    assert config.remembers and not BCImitation().remembers
    given = Given(clips, folder, 0, "improved", making.QUIET)
    cloning.clone(tmp_path / "policy", given, config)
    save = name != "touch-points"
    if save:
        eyes = Perception(PerceptionConfig(widths=(4, 4, 4), hidden=8), clips.task)
        save_perception(tmp_path / "perception", eyes, ROBOT.name)
    policy = load_policy(tmp_path / "policy", ROBOT, clips.task)
    assert policy.learner.inputs.memory_size == clips.task.goal.memory_size
    assert isinstance(policy.senses.goal, GivenGoal) != save
    (run,) = run_policy(policy, replace(clips, task=replace(clips.task, time_limit=0.2)), env_config=ONE)
    assert not run.errors


def frames_of(demos, clips, inputs):
    """A data set's frames as a learner with these inputs is shown them."""
    scenery = Scenery.of(list(clips.objects.values()), clips.task, inputs)
    return DemoFrames(
        demos, clips.objects, inputs, Window(), scenery, cloning._goals(demos, clips, are_told=inputs.targets)
    )


@pytest.mark.parametrize("cameras", [True, False])
@pytest.mark.parametrize("name", OTHERS)
def test_what_is_learned_from_is_what_will_be_observed(name, cameras, demonstrated):
    """Body, memory and map of a demonstration's frame, and of an environment in the same state."""
    clips, folder = demonstrated(name)
    inputs = replace(BCClockImitation().network.inputs, elevation=True, cameras=cameras).of(ROBOT, clips.task)
    demos = load_demos(folder, ROBOT.name, state=False)
    frames = frames_of(demos, clips, inputs)
    bank = ReferenceBank(clips.motions, ROBOT)
    env = VecEnv(clips.task, ROBOT, clips.scenes, ONE, bank=bank)
    starts = ClipStarts(bank, env.physics.add_objects(clips.scenes), ROBOT)
    env.reset(Rows.every(1, env.device), starts.at(torch.zeros(1).long(), torch.zeros(1).long()))
    known = GivenGoal(clips.task.goal)
    senses = ("proprio", "time", "odometry", inputs.map_term, "targets", "hands", "target_elevation", "views")
    obs = first = env.observe(senses)
    dict(first)  # while the robot is there
    for step in range(int(bank.lengths[0])):
        obs = env.observe(senses)
        if step == 0 and clips.task.goal.given:
            known.begin(torch.tensor([0]), obs)
        if step == int(bank.lengths[0]) - 1:
            dict(obs)  # before the robot has moved on
        env.step(torch.from_numpy(demos.executed_action[step])[None])
    last = torch.tensor([int(bank.lengths[0]) - 1])
    batch = frames.batch(last)
    assert batch.picture is not None
    torch.testing.assert_close(batch.vector[:, : 48 + 13], inputs_of(obs), atol=1e-4, rtol=0)
    same = (batch.picture[:, 0] - obs[inputs.map_term]).abs() < 2e-3
    assert same.float().mean() > (0.9998 if cameras else 0.999999), "but for pixels on an edge"
    if clips.task.goal.given:
        told = frames.pictures(torch.tensor([0]))[:, 1]
        assert 1 <= (told > -first["proprio"][:, 3] + 0.1).sum() <= 2, "each target in one cell"
        torch.testing.assert_close(told, first["target_elevation"], atol=2e-3, rtol=0)
        memory = batch.vector[:, -clips.task.goal.memory_size :]
        torch.testing.assert_close(memory, known.recall(obs), atol=5e-3, rtol=0)
    sees = InputConfig(views=True, elevation=False).of(ROBOT, clips.task)
    demos = load_demos(folder, ROBOT.name)
    frames = frames_of(demos, clips, sees)
    picture = frames.batch(last).picture
    assert picture is not None and picture.shape == obs["views"].shape
    assert (picture - obs["views"]).abs().mean() < 0.01, "but for pixels on an edge"


def inputs_of(obs):
    return torch.cat([obs["proprio"], clock_features(obs["time"][:, 0])], -1)


@pytest.mark.parametrize("task", OTHERS)
def test_from_clips_to_a_policy(task, tmp_path):
    tiny = PPOConfig(hidden=(16,), steps=8, epochs=1, minibatches=2)
    planner = PlannerConfig(hidden=(16,), samples=32, num_envs=4, steps=4, batches=1, batch=8, memory=64)
    recipe = making.small(
        task,
        objects=8,
        clips=6,
        retarget=RetargetConfig(),
        track=TrackConfig(samples=64, num_envs=8, evaluate_clips=1, ppo=tiny),
        imitate=PlannerImitation(perception=PerceptionConfig(maps=8, steps=2, batch=4), planner=planner),
        evaluate=EvaluateConfig(episodes=2),
    )
    stage = run_stage("imitate", recipe, tmp_path, making.QUIET)
    told = TASKS.get(task).goal.given
    assert (stage.folder / "perception").exists() != told
    assert (tmp_path / task / "perception").exists() != told, "nobody learns to see what is told"
    rows = judge(start(recipe, tmp_path, making.QUIET), "planner")
    assert len(rows) == 2 and not any(row.error for row in rows)
    assert np.isfinite([row.max_energy for row in rows]).all()


def test_one_planner_of_several_tasks_from_clips_to_rows_of_each(tmp_path):
    """Its stage has the eyes of each task that needs some, and rows of another task say which they were."""
    sizes = {"hidden": (16,), "clock": False, "samples": 64, "num_envs": 4, "steps": 4, "batches": 1}
    planner = PlannerConfig(**sizes, batch=8, memory=64)
    eyes = PerceptionConfig(maps=8, steps=2, batch=4)
    learned = PlannerImitation(perception=eyes, planner=planner, also=("sit-chair",))
    recipe = making.small(
        "touch-points",
        objects=6,
        clips=3,
        retarget=RetargetConfig(),
        imitate=learned,
        evaluate=EvaluateConfig(episodes=1),
    )
    stage = run_stage("imitate", recipe, tmp_path, making.QUIET)
    seen = [path.parents[1].name for path in stage.folder.rglob("perception/config.json")]
    assert seen == ["sit-chair"], "what is told needs no eyes"
    digests = {}
    for task in ("touch-points", *learned.also):
        there = start(replace(recipe, task=task, imitate=None), tmp_path, making.QUIET)
        rows = judge(there, str(stage.folder / "policy"))
        assert len(rows) == 1 and not rows[0].error
        who = who_of(there, str(stage.folder / "policy"))
        digests[task] = who.digests
        assert who.name == rows[0].policy == stage.folder.name, "all policies of a workdir are in a folder `policy`"
    assert len(set(map(str, digests.values()))) == 1 and "sit-chair/perception" in digests["sit-chair"]


def test_a_hand_that_has_nothing_to_do_is_on_no_map():
    """Whom recordings show reaching with one hand: neither in what is learned from nor in what is observed."""
    task, obj = TASKS.get("touch-points"), make_object("household-0-00000")
    count = 60
    root, quat = np.tile([-0.6, 0.0, 1.0], (count, 1)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    pose, goal = np.tile(ROBOT.rest_pose, (count, 1)), np.array([[-0.2, 0.15, 0.8], [np.nan] * 3])
    motion = RobotMotion(
        "one", task.name, ROBOT.name, ROBOT.joint_names, 50.0, root, quat, pose, obj.id, "person", wrist_goal_w=goal
    )
    clips = ClipSet(task, ROBOT, [motion], {obj.id: obj})
    demos = Demos(
        ROBOT.name, task.title, 50.0, ROBOT.joint_names, np.array([0, count]), None, pose.astype("f"),
        pose.astype("f"), np.concatenate([root, quat, pose], 1), np.zeros((count, 25)), (obj.id,), ("one",),
        np.array([True]),
    )  # fmt: skip
    frames = frames_of(demos, clips, InputConfig(body="proprio").of(ROBOT, task))
    told = frames.pictures(torch.tensor([0]))[0, 1]
    env = VecEnv(task, ROBOT, [obj], ONE)
    env.reset(Rows.every(1, "cpu"), stacked([start_of(motion, obj, ROBOT, task)], env.physics))
    np.testing.assert_allclose(told, env.observe(["target_elevation"])["target_elevation"][0], atol=1e-6)
    assert (told > told.min() + 0.01).sum() == 1
