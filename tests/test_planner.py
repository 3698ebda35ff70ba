"""The planner: what it sees, how it learns at every task, and that a kill loses nothing."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import safetensors
import torch

from learning import ONE, ROBOT, clip_of, shape_of, tracker
from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.settings import BadSetting
from mimicbench.core.training import STATE
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.dagger import SEEN, Episodes
from mimicbench.imitate.goals import both_places, given_goal, goals_of
from mimicbench.imitate.learn_planner import _Run, train_planner
from mimicbench.imitate.learners.planner import PlannerConfig, PlannerImitation
from mimicbench.imitate.networks.planner import PlannerSizes, columns_of
from mimicbench.imitate.perception import Perception, save_perception
from mimicbench.imitate.plan import PlanLayout
from mimicbench.imitate.planner import load_network, load_planner, save_planner
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.objects.families.chair import make_chair
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.methods.optimization import optimize
from mimicbench.robots.mirror import toggled
from mimicbench.sensors.observations import Observations
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import save_tracker
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import TrackingConfig
from mimicbench.track.trackers.residual import ResidualConfig
from mimicbench.track.tracking import TrackingEnv

TASK = TASKS.get("sit-chair")
SMALL = PlannerConfig(
    hidden=(16,), samples=8 * 4 * 3, num_envs=8, steps=4, batches=2, batch=16, memory=256, save_every=0.0
)


@pytest.fixture(scope="module")
def every():
    """A clip of each task, made when it is asked for."""
    made = {}

    def of(name):
        if name not in made:
            made[name] = clip_of(TASKS.get(name))
        return made[name]

    return of


@pytest.fixture(scope="module")
def clips():
    chairs = [make_chair(index) for index in range(2)]
    motions = [
        optimize(Clip(synthesize("sit-chair", index, chair, 0), chair, ROBOT)) for index, chair in enumerate(chairs)
    ]
    return ClipSet(TASK, ROBOT, motions, {chair.id: chair for chair in chairs})


SHAPE, SIX = shape_of("residual", TASK), shape_of("residual", *TASKS.all())


def saved(folder, task, network, shape):
    """The folder of a planner with all that it needs beside it."""
    save_planner(folder / "planner", ROBOT, network, SMALL, {})
    save_tracker(folder / "tracker", ROBOT, shape, tracker(shape).network.tensors(), {})
    if not task.goal.given:
        eyes = Perception(PerceptionConfig(widths=(4, 4, 4), hidden=8), task)
        save_perception(folder / "perception", eyes, ROBOT.name)
    return folder / "planner"


@pytest.mark.parametrize("task", TASKS.all(), ids=lambda task: task.name)
def test_every_task_is_learned_over_one_tracker_of_all(task, every, tmp_path):
    clips = every(task.name)
    network = train_planner(tmp_path / "training", tracker(SIX), [clips], SMALL, 0, ONE)
    policy = load_planner(saved(tmp_path, task, network, SIX), ROBOT, task)
    inputs = torch.randn(3, network.sizes.inputs)
    assert torch.equal(policy._network.plan(inputs), network.plan(inputs))
    told = {term.name for term in PlanLayout(TRACKERS.get("residual"), ROBOT, task).terms}
    assert told >= {"reference+1", "reference+5"} and ("object+5" in told) == task.moves_object
    assert ("targets" in policy.observations) == task.goal.given != ("elevation" in policy.observations)
    short = replace(clips, task=replace(task, time_limit=0.2), motions=[*clips.motions] * 2)
    (run,) = run_policy(policy, short, env_config=ONE)
    assert not run.errors and run.verdict.steps.tolist() == [10, 10] and not run.verdict.diverged.any()


SEVERAL = replace(SMALL, clock=False, num_envs=9, batch=18)


def several(every, folder):
    """A planner of three tasks, and its clips: one finds its goal, one is told it, one moves its object."""
    sets = [every(name) for name in ("sit-chair", "touch-points", "lift-box")]
    return train_planner(folder / "training", tracker(SIX), sets, SEVERAL, 0, ONE), sets


def test_one_network_learns_several_tasks_and_is_told_which(every, tmp_path):
    network, sets = several(every, tmp_path)
    tasks = [some.task for some in sets]
    columns = columns_of(TRACKERS.get("residual"), ROBOT, tasks)
    assert network.sizes.memory == sum(task.goal.memory_size for task in tasks) + len(tasks)
    assert network.sizes.plan == columns[2].plans > columns[0].own(torch.zeros(1, columns[0].plans)).shape[1]
    for number, (some, where) in enumerate(zip(sets, columns, strict=True)):
        folder = saved(tmp_path / some.task.name, some.task, network, SIX)
        save_planner(folder, ROBOT, network, SEVERAL, {"tasks": [task.name for task in tasks]})
        policy = load_planner(folder, ROBOT, some.task)
        told = where.told(torch.full((2, some.task.goal.memory_size), 5.0))
        assert told[:, -len(tasks) :].tolist() == [[float(number == other) for other in range(len(tasks))]] * 2
        assert int((told == 5).sum()) == 2 * some.task.goal.memory_size and (told[:, where.memory] == 5).all()
        (run,) = run_policy(policy, replace(some, task=replace(some.task, time_limit=0.1)), env_config=ONE)
        assert not run.errors and run.verdict.steps.tolist() == [5]


def test_what_tasks_share_of_a_plan_has_the_same_columns(every):
    seat, lift = (PlanLayout(TRACKERS.get("residual"), ROBOT, TASKS.get(name)) for name in ("sit-chair", "lift-box"))
    one, other = columns_of(TRACKERS.get("residual"), ROBOT, [TASKS.get("sit-chair"), TASKS.get("lift-box")])
    plans = torch.arange(one.plans).float()[None]
    said = seat.split(one.own(plans)), lift.split(other.own(plans))
    assert set(said[1]) - set(said[0]) == {"object", "object+1", "object+5"} and one.plans == lift.size
    assert all(torch.equal(values, said[1][name]) for name, values in said[0].items())


def test_a_planner_of_several_tasks_is_refused_at_others(every, tmp_path):
    network, _ = several(every, tmp_path)
    bed = TASKS.get("lie-bed")
    folder = saved(tmp_path, bed, network, SIX)
    save_planner(folder, ROBOT, network, SEVERAL, {"tasks": ["sit-chair", "touch-points", "lift-box"]})
    with pytest.raises(BadCheckpoint, match="learned at sit-chair, touch-points, lift-box"):
        load_planner(folder, ROBOT, bed)


def test_a_training_of_several_tasks_goes_on_to_the_same_bytes(every, tmp_path):
    whole, sets = several(every, tmp_path)

    def kill(row):
        if row["round"] == 2:
            raise Killed

    with pytest.raises(Killed):
        train_planner(tmp_path / "killed", tracker(SIX), sets, SEVERAL, 0, ONE, kill)
    resumed = train_planner(tmp_path / "killed", tracker(SIX), sets, SEVERAL, 0, ONE)
    assert all(torch.equal(value, resumed.state_dict()[name]) for name, value in whole.state_dict().items())


def test_who_learns_several_tasks_sees_no_clock():
    with pytest.raises(BadSetting, match="no-clock"):
        PlannerImitation(also=("sit-sofa",))


def test_who_sees_no_clock_does_the_same_whatever_the_time(every, tmp_path):
    clips, config = every("sit-chair"), replace(SMALL, clock=False)
    network = train_planner(tmp_path / "training", tracker(SHAPE), [clips], config, 0, ONE)
    folder = saved(tmp_path, TASK, network, SHAPE)
    save_planner(folder, ROBOT, network, config, {})
    policy = load_planner(folder, ROBOT, TASK)
    assert network.sizes.style == network.sizes.clock == 0
    timed = PlannerSizes.of(ROBOT, [TASK], TRACKERS.get("residual"), 0)
    assert timed.inputs - network.sizes.inputs == CLOCK_SIZE

    env = TrackingEnv(TRACKERS.get("residual"), clips, 2, TrackingConfig(), 0, ONE).env
    seen = env.observe(policy.observations)

    def said(seconds):
        values = {name: seen[name] for name in policy.observations}
        obs = Observations({**values, "time": torch.full_like(values["time"], seconds)})
        policy.reset(torch.arange(obs.num_envs), obs)
        return policy.act(obs)

    assert torch.equal(said(0.0), said(7.3))


@pytest.mark.parametrize(("design", "own"), [("hst", {"body", "gravity"}), ("hst-original", {"tilt", "joint_offset"})])
def test_the_papers_trackers_are_planned_for_too(every, tmp_path, design, own):
    clips, shape = every("touch-points"), shape_of(design, TASKS.get("touch-points"))
    network = train_planner(tmp_path / "training", tracker(shape), [clips], SMALL, 0, ONE)
    policy = load_planner(saved(tmp_path, clips.task, network, shape), ROBOT, clips.task)
    assert {*own, "targets"} <= set(policy.observations) and policy.gains == "paper"
    short = replace(clips, task=replace(clips.task, time_limit=0.1))
    assert not run_policy(policy, short, env_config=ONE)[0].errors


def test_training_is_the_same_again_whatever_the_threads(clips, tmp_path):
    first = train_planner(tmp_path / "a", tracker(SHAPE), [clips], SMALL, 0, EnvConfig(workers=1))
    again = train_planner(tmp_path / "b", tracker(SHAPE), [clips], SMALL, 0, EnvConfig(workers=2))
    for name, value in first.state_dict().items():
        assert torch.equal(value, again.state_dict()[name]), name
    finished = train_planner(tmp_path / "a", tracker(SHAPE), [clips], SMALL, 0, EnvConfig(workers=1))
    assert all(torch.equal(value, finished.state_dict()[name]) for name, value in first.state_dict().items())


def test_learning_goes_on_from_another_planner(clips, tmp_path):
    first = train_planner(tmp_path / "first", tracker(SHAPE), [clips], SMALL, 0, ONE)
    save_planner(tmp_path / "planner", ROBOT, first, SMALL, {})
    there = load_network(tmp_path / "planner", ROBOT)
    still = replace(SMALL, learning_rate=0.0)
    same = train_planner(tmp_path / "same", tracker(SHAPE), [clips], still, 1, ONE, begin_from=there)
    for name, value in first.state_dict().items():
        assert torch.equal(value, same.state_dict()[name]), name
    on = train_planner(tmp_path / "on", tracker(SHAPE), [clips], SMALL, 1, ONE, begin_from=there)
    assert not torch.equal(first.layers[0].weight, on.layers[0].weight)
    with pytest.raises(BadSetting, match="other layers"):
        train_planner(tmp_path / "no", tracker(SHAPE), [clips], replace(SMALL, hidden=(8,)), 1, ONE, begin_from=there)


def test_who_goes_on_from_another_planner_tells_styles_as_it_does(clips):
    clock = replace(SMALL, clock=True)
    there = _Run(tracker(SHAPE), [clips], clock, 0, ONE).network.state_dict()
    there["style_mean"] = there["style_mean"] + 0.25
    run = _Run(tracker(SHAPE), [clips], clock, 0, ONE)
    (task,) = run.tasks
    before = task.episodes.styles
    run.begin_from(there)
    assert before.shape[1] > 0
    torch.testing.assert_close(task.episodes.styles, before - 0.25 / run.network.style_std)


def test_a_planner_may_drive_from_the_first_round_on(clips, tmp_path):
    train_planner(tmp_path, tracker(SHAPE), [clips], replace(SMALL, teacher_share=0.0), 0, ONE)


class Killed(Exception):
    """As by a signal, between two rounds."""


@pytest.mark.parametrize("shape", [SHAPE, shape_of("hst-original", TASK)], ids=lambda shape: shape.tracker)
def test_a_training_killed_in_the_middle_ends_in_the_same_bytes(clips, tmp_path, shape):
    longer = replace(SMALL, samples=8 * 4 * 30, save_every=0.0)
    whole = train_planner(tmp_path / "whole", tracker(shape), [clips], longer, 0, EnvConfig(workers=1))

    def kill(row):
        if row["round"] == 20:
            raise Killed

    with pytest.raises(Killed):
        train_planner(tmp_path / "killed", tracker(shape), [clips], longer, 0, EnvConfig(workers=1), kill)
    resumed = train_planner(tmp_path / "killed", tracker(shape), [clips], longer, 0, EnvConfig(workers=1))
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name


def test_a_clip_waits_for_who_lags_and_hurries_for_who_is_ahead(clips):
    """By a frame each, on the way alone, and only where the planner drives."""
    calm = ClipStartConfig(first_frame=1.0, pos_noise=0.0, angle_noise=0.0, vel_noise=0.0)
    config = replace(SMALL, pace=1.0, tracking=replace(SMALL.tracking, starts=calm, focus=0.0))
    (run,) = _Run(tracker(SHAPE), [clips], config, 0, EnvConfig(workers=1)).tasks
    env, bank = run.env.env, run.env.bank
    place = [bank.frame(env.clip, env.index + ahead).root_pos_w[:, :2] for ahead in range(400)]
    gone = torch.stack([(one - place[0]).norm(dim=-1) for one in place])
    assert (gone[-1] > 0.3).all(), "they walk"
    walked = (gone > 0.2).int().argmax(0)  # the clip is so far ahead of robots that stand where it began
    for teacher, index, moved in ((False, walked, -1), (True, walked, 0), (False, bank.lengths[env.clip] - 1, 0)):
        run.drivers.teacher[:] = teacher
        env.index[:] = index
        run.keep_pace()
        assert (env.index - index == moved).all()
    run.drivers.teacher[:] = False
    env.index[:] = 0
    run.keep_pace()
    assert (env.index == 0).all(), "who is where the clip is"
    run.env.env.close()


def test_mirror_images_of_all_clips_are_learned_from_too(clips, tmp_path):
    train_planner(tmp_path, tracker(SHAPE), [clips], replace(SMALL, mirrored=True), 0, EnvConfig(workers=1))
    with safetensors.safe_open(tmp_path / STATE, "pt") as file:
        learned = json.loads(file.metadata()["mimicbench"])["identity"]["clips"]
    names = [motion.id for motion in clips.motions]
    assert learned == [*names, *(toggled(name) for name in names)]


def test_another_training_is_not_taken_up(clips, tmp_path):
    train_planner(tmp_path, tracker(SHAPE), [clips], SMALL, 0, EnvConfig(workers=1))
    with pytest.raises(MimicbenchError, match="another seed"):
        train_planner(tmp_path, tracker(SHAPE), [clips], SMALL, 1, EnvConfig(workers=1))


def test_a_plan_is_what_the_tracker_would_be_told(every):
    """Also where the object is turned by half a circle, which rotation vectors say in two ways."""
    env = TrackingEnv(TRACKERS.get("residual"), every("lift-box"), 4, TrackingConfig(), 0, ONE)
    layout, terms = PlanLayout(env.spec, ROBOT, env.clips.task), dict(env.terms())
    turn = torch.tensor([[0, 0, math.pi - 1e-3], [0, 0, 1e-3 - math.pi], [0.3, -0.2, 1.0], [0, 0, 0]])
    terms["object+1"] = torch.cat([terms["object+1"][:, :3], turn, terms["object+1"][:, 6:]], 1)
    plan = layout.flat(terms)
    assert plan.shape == (4, layout.size) and layout.size == 2 * 50 + 3 * 15
    found = layout.split(plan)
    assert set(found) == {"reference+1", "reference+5", "object", "object+1", "object+5"}
    for name, values in found.items():
        torch.testing.assert_close(values, terms[name], atol=1e-4, rtol=0)
    # as numbers to learn, what is nearly the same turn is nearly the same
    assert (plan[0] - plan[1])[-30:-15][3:9].abs().max() < 3e-3


def test_memory_in_training_is_what_the_robot_would_carry(clips):
    """The goal that a training robot remembers is where odometry from the start of the clip says it is."""
    quiet = TrackingConfig(ClipStartConfig(1.0, 0.0, 0.0, 0.0), push=0.0)
    env = TrackingEnv(TRACKERS.get("residual"), clips, 4, quiet, 0, ONE)
    episodes = Episodes(env, *columns_of(env.spec, ROBOT, [env.clips.task]), torch.zeros(2, 0), 0)
    for _ in range(25):
        env.step(torch.zeros(4, 19), ResidualConfig())
    carried = TASK.goal.carried(episodes.known, env.context.odometry_pos, env.context.odometry_yaw)
    found = episodes.inputs(env.env.observe(SEEN))
    np.testing.assert_allclose(found[:, -10:].numpy(), carried.numpy(), atol=5e-3)


def test_what_is_told_is_where_it_is_from_any_posture(every):
    clips = every("touch-points")
    tilted = TrackingConfig(ClipStartConfig(0.0, 0.1, 0.3, 0.0))
    env = TrackingEnv(TRACKERS.get("residual"), clips, 6, tilted, 0, ONE)
    state, spec, seen = env.context.state, clips.task.goal, env.env.observe(SEEN)
    truth = spec.to_root(goals_of(clips), state.root_pos_w, rot.yaw_of(state.root_quat_w))
    found = given_goal(spec, seen["targets"], seen["hands"], seen["proprio"])
    torch.testing.assert_close(found, truth, atol=1e-5, rtol=0)
    one_hand = replace(clips.motions[0], wrist_goal_w=np.array([[np.nan] * 3, [1.0, 2.0, 3.0]]))
    found = goals_of(replace(clips, motions=[one_hand]))
    assert found.isfinite().all() and found[0, 3:].tolist() == [1, 2, 3]


def test_a_hand_that_is_told_nothing_is_held_beside_the_other():
    told = torch.tensor([[[torch.nan] * 3, [2.0, 0.0, 1.0]], [[0.0, 3.0, 0.5], [torch.nan] * 3]])
    told = torch.cat([told, torch.tensor([[[1.0, 0.2, 0.9], [1.0, -0.2, 0.8]]])])
    left, right = both_places(told)[0], both_places(told)[1]
    torch.testing.assert_close(left, torch.tensor([[2.0, 0.3, 1.0], [2.0, 0.0, 1.0]]))
    torch.testing.assert_close(right, torch.tensor([[0.0, 3.0, 0.5], [0.3, 3.0, 0.5]]))
    assert torch.equal(both_places(told)[2], told[2]), "who is told two places goes there"


def test_goals_stand_where_objects_stand_first(every):
    clips = every("lift-box")
    motion = clips.motions[0]
    turned = rot.multiply(rot.from_yaw(np.array(0.5)), motion.object_quat_w)
    moved = replace(motion, object_pos_w=motion.object_pos_w + [1.0, 2.0, 0.0], object_quat_w=turned)
    found = goals_of(replace(clips, motions=[motion, moved]))
    np.testing.assert_allclose(found[1, :4] - found[0, :4], [1, 2, math.sin(0.5), math.cos(0.5) - 1], atol=1e-5)


def test_clocks_show_all_times_to_the_limit_while_a_pose_is_held(every):
    clips = every("lift-box")
    hold = TrackingConfig(ClipStartConfig(1.0), hold=2.0)
    env = TrackingEnv(TRACKERS.get("residual"), clips, 64, hold, 0, ONE)
    episodes, length, limit = (
        Episodes(env, *columns_of(env.spec, ROBOT, [env.clips.task]), torch.zeros(1, 0), 0),
        int(env.bank.lengths[0]),
        clips.task.time_limit,
    )
    env.env.index = torch.full_like(env.env.index, length - 1)
    assert (episodes.seconds == (length - 1) * CONTROL_DT).all(), "in the clip it is the clip's own"
    env.env.index = env.env.index + 1
    first, last = length * CONTROL_DT, limit - hold.hold
    assert (episodes.seconds >= first - 1e-5).all() and (episodes.seconds <= last + 1e-3).all()
    assert episodes.seconds.min() < first + 0.5 and episodes.seconds.max() > last - 0.5
    env.env.index = env.env.index + round(hold.hold / CONTROL_DT)
    assert abs(float(episodes.seconds.max()) - limit) < 0.5, "held to the last"
    # and what is to be done then is to be where the clip ended, at rest
    wanted = env.bank.frame(env.env.clip, env.env.index)
    assert not wanted.joint_vel.any() and not wanted.object.lin_vel_w.any()
