"""The environment that everything runs in: hooks that push, delay, disturb and assist, and state that is whole."""

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.hooks import ActionDelay, ActionNoise, AssistingWrench, Pushes
from mimicbench.envs.initial_states import InitialState, stacked
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.objects.registry import make_object
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import ObjectState, RobotState
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from stool import H1, block, standing

SIT_CHAIR = TASKS.get("sit-chair")
POS, JOINTS = standing()
TARGET = torch.tensor(JOINTS, dtype=torch.float32)


def still(obj, count):
    """`count` robots that stand at rest before an object."""
    zeros = np.zeros(3)
    return [InitialState(obj, POS, rot.IDENTITY, JOINTS, zeros, zeros, np.zeros(19)) for _ in range(count)]


def environment(count=2, hooks=(), seed=0, bank=None, **config):
    env = VecEnv(SIT_CHAIR, H1, [block()] * count, EnvConfig(workers=1, **config), seed, bank, hooks)
    env.reset(Rows.every(count), stacked(still(block(), count), env.physics))
    return env


def resting(away, seconds=2.0):
    """A clip that stands still, `away` (3,) [m] from where the robots of these tests begin."""
    frames = int(seconds * 50)
    pos, quat = np.tile(POS + away, (frames, 1)), np.tile(rot.IDENTITY, (frames, 1))
    return RobotMotion(
        "rest", "sit-chair", "h1", H1.joint_names, 50.0, pos, quat, np.tile(JOINTS, (frames, 1)), block().id, "rest"
    )


def test_what_is_felt_does_not_depend_on_how_many_others_there_are():
    random = np.random.default_rng(0)
    quat = rot.normalize(random.normal(size=(128, 4)) * [1.0, 0.3, 0.3, 1.0])
    starts = [InitialState(block(), POS, q, JOINTS, *random.normal(size=(2, 3)), np.zeros(19)) for q in quat]

    def felt(some):
        env = VecEnv(SIT_CHAIR, H1, [block()] * len(some), EnvConfig(workers=1))
        env.reset(Rows.every(len(some)), stacked(some, env.physics))
        for _ in range(3):
            env.step(TARGET.expand(len(some), -1))
        return env.observe(("odometry", "tilt"))

    together = felt(starts)
    for k in (0, 63, 97, 127):
        alone = felt([starts[k]])
        for name in ("odometry", "tilt"):
            assert torch.equal(together[name][k], alone[name][0]), (name, k)


def test_how_far_a_box_is_follows_it():
    box = block(0.4, 0.2, movable=True, mass=2.0)
    env = VecEnv(TASKS.get("lift-box"), H1, [box], EnvConfig(workers=1))
    env.reset(Rows.every(1), stacked(still(box, 1), env.physics))
    before, state = env.root_distance(), env.context.state
    away = torch.tensor([[-1.5, 0.0, 0.0]], dtype=torch.float64)
    none = torch.zeros(1, 3, dtype=torch.float64)
    box_there = ObjectState(away, torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64), none, none)
    rest = (state.root_quat_w, state.root_lin_vel_w, state.root_ang_vel_b, state.joint_pos, state.joint_vel)
    robot_there = RobotState(state.root_pos_w.double() + away, *(value.double() for value in rest))
    env.physics.reset(Rows.every(1), robot_there, box_there)
    env.step(TARGET[None])
    assert float((env.root_distance() - before).abs()) < 0.02, "both are 1.5 m farther"


def test_pushes_come_as_often_and_as_hard_as_they_should():
    hook = Pushes(deviation=0.5, interval=0.1)  # every fifth step in the mean
    env = environment(400, (hook,))
    changed = []

    def push(velocity):
        changed.append(velocity)

    env.physics.push = push
    for _ in range(20):
        hook.before_step(env.context, TARGET.expand(400, -1), env.random)
    velocity = torch.stack(changed)  # (20, 400, 3)
    hit = (velocity != 0).any(-1)
    assert float(hit.float().mean()) == pytest.approx(CONTROL_DT / 0.1, rel=0.1)
    assert float(velocity[hit][:, :2].std()) == pytest.approx(0.5, rel=0.1)
    assert not velocity[..., 2].any(), "nobody is thrown upwards"


def test_a_push_moves_the_robot_and_the_seed_decides_which():
    runs = [environment(6, (Pushes(1.0, 0.04),), seed) for seed in (0, 0, 1)] + [environment(6)]
    for env in runs:
        for _ in range(5):
            env.step(TARGET.expand(6, -1))
    first, again, other, calm = (env.physics.qpos().copy() for env in runs)
    np.testing.assert_array_equal(first, again)
    assert (first != other).any() and (first != calm).any(-1).sum() >= 3


def test_noise_is_on_what_is_applied_and_not_on_the_targets():
    deviation = torch.tensor([[0.0], [0.1]]).repeat(50, 1)
    env = environment(100, (ActionNoise(deviation),))
    target = TARGET.expand(100, -1)
    env.step(target)
    noise = env.applied - target
    assert not noise[::2].any() and float(noise[1::2].std()) == pytest.approx(0.1, rel=0.1)
    assert torch.equal(env.last_target, target), "whoever records the targets records them clean"


def test_targets_arrive_late_and_each_episode_waits_anew():
    env = environment(2, (ActionDelay(2),))
    sent = [TARGET.expand(2, -1) + 0.01 * step for step in range(1, 6)]
    arrived = []
    for step, target in enumerate(sent):
        if step == 3:  # the second robot begins anew: what was on its way to it is gone
            rows = Rows.of([1], 2)
            env.reset(rows, stacked(still(block(), 1), env.physics))
        env.step(target)
        arrived.append(env.applied.clone())
    for step in range(5):
        torch.testing.assert_close(arrived[step][0], TARGET if step < 2 else sent[step - 2][0])
    torch.testing.assert_close(arrived[2][1], sent[0][1])
    for step in (3, 4):
        torch.testing.assert_close(arrived[step][1], TARGET)


@pytest.mark.parametrize("away", [(0.0, 0.3, 0.0), (0.0, 0.0, 0.6)])
def test_an_assisting_wrench_pulls_the_robot_towards_its_reference(away):
    reached = []
    for share in (None, 0.0, 1.0):
        hooks = () if share is None else (AssistingWrench(share=share),)
        env = environment(1, hooks, bank=ReferenceBank([resting(np.array(away))], H1))
        for _ in range(10):
            env.step(TARGET.expand(1, -1))
        reached.append(env.physics.qpos()[0].copy())
    alone, nothing, pulled = reached
    np.testing.assert_array_equal(alone, nothing)
    gained = (pulled - alone)[:3] @ np.array(away) / np.linalg.norm(away)
    assert gained > 0.02, "0.2 s of 450 N to the side, or of 900 N against a weight of 500 N"


def test_an_assisting_wrench_turns_the_robot_towards_its_reference():
    motion = resting(np.zeros(3))
    motion.root_quat_w[:] = rot.from_yaw(np.array(0.5))
    env = environment(1, (AssistingWrench(force=0.0),), bank=ReferenceBank([motion], H1))
    for _ in range(10):
        env.step(TARGET.expand(1, -1))
    assert rot.yaw_of(env.context.state.root_quat_w)[0] > 0.05
    assert np.abs(env.physics.qpos()[0, :2] - POS[:2]).max() < 0.1


def test_nothing_is_known_before_the_first_reset_and_no_reference_without_clips():
    env = VecEnv(SIT_CHAIR, H1, [block()], EnvConfig(workers=1))
    with pytest.raises(MimicbenchError, match="call reset"):
        env.observe(["proprio"])
    env = environment(1)
    with pytest.raises(MimicbenchError, match="follow no clips"):
        env.observe(["reference+1"])["reference+1"]


def test_sensors_are_as_noisy_as_they_say():
    env = environment(200, noise={"joint_pos": 0.05})
    obs = env.observe(["joint_pos", "joint_vel"])
    error = obs["joint_pos"] - env.context.state.joint_pos
    assert float(error.std()) == pytest.approx(0.05, rel=0.05)
    assert torch.equal(obs["joint_pos"], obs["joint_pos"]), "one measurement a step"
    assert torch.equal(obs["joint_vel"], env.context.state.joint_vel)


def test_some_go_on_while_others_wait():
    env = environment(2)
    env.step(TARGET.expand(2, -1), running=torch.tensor([True, False]))
    assert env.steps.tolist() == [1, 0] and env.metrics.steps.tolist() == [1, 0]
    assert env.last_target.any(-1).tolist() == [True, False]


def moving(count=3):
    """Physics of boxes between robots, all of them moving, some pushed and assisted."""
    box = make_object("box-0-00003")
    physics = NativePhysics(H1, [box, make_object("box-0-00004"), box][:count], workers=1)
    random = np.random.default_rng(0)
    quat = np.tile(rot.from_yaw(np.array(0.4)), (count, 1))
    pos = np.tile(POS, (count, 1))
    robot = RobotState.of(pos, quat, np.tile(JOINTS, (count, 1)), random.normal(size=(count, 3)) * 0.1)
    spin = torch.tensor(random.normal(size=(count, 3)))
    high = torch.tensor([[0.3, 0.1, 0.8]]).expand(count, -1)
    state = ObjectState(high, torch.from_numpy(quat), spin * 0.1, spin)
    physics.reset(Rows.every(count), robot, state)
    physics.assist(torch.full((count, 3), 20.0), torch.full((count, 3), 2.0))
    return physics


def test_a_reset_leaves_the_callers_action_as_it_was():
    """PPO keeps what it gave until it has seen what came of it, when the episode may have begun anew."""
    env, target, action = environment(3), TARGET.repeat(3, 1), torch.ones(3, 19)
    env.step(target, action)
    env.reset(env.rows(torch.tensor([True, False, True])), stacked(still(block(), 2), env.physics))
    assert (action == 1).all() and (target == TARGET).all()
    assert env.last_action[:, 0].tolist() == [0, 1, 0] and env.context.last_action[:, 0].tolist() == [0, 1, 0]


def test_physics_are_taken_up_to_the_last_bit():
    physics, other = moving(), moving()
    random = np.random.default_rng(1)
    targets = [torch.tensor(JOINTS + 0.2 * random.normal(size=(3, 19))) for _ in range(12)]
    for target in targets[:6]:
        physics.step(target, measure_effort=True)
    rows = Rows.of([0], 3)
    physics.set_objects(rows, torch.tensor([1]))
    saved = physics.state_tensors()
    assert other.qpos().tobytes() != physics.qpos().tobytes()
    other.load_state_tensors(saved)
    assert [obj.id for obj in other.objects] == [obj.id for obj in physics.objects]
    for target in targets[6:]:
        physics.step(target, measure_effort=True)
        other.step(target, measure_effort=True)
        assert physics.qpos().tobytes() == other.qpos().tobytes()
        assert physics.qvel().tobytes() == other.qvel().tobytes()
        assert torch.equal(physics.effort, other.effort)
    changed = {name for name, value in saved.items() if not torch.equal(value, physics.state_tensors()[name])}
    assert {"qpos", "qvel", "effort"} <= changed, "what was saved is a copy"


def test_an_environment_with_hooks_is_taken_up_to_the_last_bit():
    bank = ReferenceBank([resting(np.array([0.1, 0.0, 0.0]))], H1)

    def make():
        hooks = (Pushes(0.3, 0.1), ActionDelay(3), ActionNoise(0.02), AssistingWrench(share=0.3))
        return environment(3, hooks, bank=bank, noise={"joint_pos": 0.01})

    whole, other = make(), make()
    random = torch.Generator().manual_seed(0)
    targets = [TARGET + 0.1 * torch.randn(3, 19, generator=random) for _ in range(20)]
    for target in targets[:10]:
        whole.step(target)
    other.load_state_tensors(whole.state_tensors())
    for target in targets[10:]:
        whole.step(target)
        other.step(target)
        seen, again = (env.observe(["state", "joint_pos", "odometry"]) for env in (whole, other))
        for name in seen:
            assert torch.equal(seen[name], again[name]), name
    assert whole.physics.qpos().tobytes() == other.physics.qpos().tobytes()
    for name, value in vars(whole.metrics.verdict()).items():
        torch.testing.assert_close(value, getattr(other.metrics.verdict(), name), equal_nan=True, rtol=0, atol=0)


def test_clips_are_entered_where_they_say():
    motion = resting(np.array([0.0, 0.0, 0.02]), 1.0)
    motion.root_pos_w[:, 0] += np.linspace(0.0, 0.5, motion.frames)
    bank = ReferenceBank([motion], H1)
    env = VecEnv(SIT_CHAIR, H1, [block()] * 2, EnvConfig(workers=1), bank=bank)
    starts = ClipStarts(bank, env.physics.add_objects([block()]), H1)
    env.reset(Rows.every(2), starts.at(torch.tensor([0, 0]), torch.tensor([0, 20])))
    frame = env.context.reference(0)
    torch.testing.assert_close(env.context.state.root_pos_w, frame.root_pos_w)
    assert env.context.state.root_pos_w[1, 0] > env.context.state.root_pos_w[0, 0] + 0.15
    assert env.index.tolist() == [0, 20]
