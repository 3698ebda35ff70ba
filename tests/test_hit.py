"""HIT says poses, and what its tracker is told of them is what it would be told by the clip itself."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from learning import ONE, ROBOT, shape_of, tracker
from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import save_checkpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.core.run import RunContext
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import VecEnv
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate.learned import save_learner
from mimicbench.imitate.learners.hit import HITConfig, HITImitation, learn
from mimicbench.imitate.lerobot import Demos
from mimicbench.imitate.networks.hit import load_hit
from mimicbench.imitate.plan import PosePlan
from mimicbench.imitate.spec import Given
from mimicbench.imitate.stored.poses import ClipPlans, motions_of
from mimicbench.objects.registry import FAMILIES
from mimicbench.policies.loading import load_policy
from mimicbench.sensors.observations import chosen_terms
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from mimicbench.track.experts import Corrigible
from mimicbench.track.registry import TRACKERS
from test_imitate import TINY

FRAMES, JOINTS = 60, len(ROBOT.joints)
POSES = ("sit-chair", "touch-points", "lift-box")


def gliding(task):
    """A robot that glides and turns slowly while its joints swing; what it moves goes along."""
    obj, time = FAMILIES.get(task.family).make(0, 0), np.arange(FRAMES) / 50
    pos = np.stack([1.5 - 0.4 * time, 0.1 * time**2, 1.0 + 0.02 * np.sin(time)], -1)
    quat = rot.from_rotvec(np.stack([0.1 * np.sin(time), 0.05 * time, 0.3 * time], -1))
    swing = 0.1 * np.sin(time[:, None] + np.arange(JOINTS))
    more = {}
    if task.moves_object:
        turn = rot.from_rotvec(np.stack([0 * time, 0.1 * time, 0.2 * time], -1))
        more = {"object_pos_w": pos + [0.4, 0.0, -0.3], "object_quat_w": turn}
    if task.wrist_goals:
        more = {"wrist_goal_w": np.array([[0.3, 0.2, 0.9], [0.4, -0.3, 1.1]])}
    joints = np.clip(ROBOT.rest_pose + swing, ROBOT.joint_range[:, 0], ROBOT.joint_range[:, 1])
    name = ROBOT.name
    motion = RobotMotion("clip", task.name, name, ROBOT.joint_names, 50.0, pos, quat, joints, obj.id, "clip", **more)
    return ClipSet(task, ROBOT, [motion], {obj.id: obj})


def followed(clips):
    """A demonstration whose robot and object are a little beside the clip's."""
    bank, random = ReferenceBank(clips.motions, ROBOT), np.random.default_rng(0)
    frame = bank.frame(torch.zeros(FRAMES).long(), torch.arange(FRAMES))
    pos, off = frame.root_pos_w.numpy(), 0.03 * random.normal(size=3)
    quat = rot.multiply(frame.root_quat_w.numpy(), rot.from_rotvec(np.tile([0.02, -0.03, 0.04], (FRAMES, 1))))
    qpos = np.concatenate([pos + off, quat, frame.joint_pos.numpy() + 0.01], -1)
    qvel = np.concatenate([frame.root_lin_vel_w, frame.root_ang_vel_w, frame.joint_vel], -1)
    if clips.task.moves_object:
        obj = frame.object
        qpos = np.concatenate([qpos, obj.pos_w + 0.01, obj.quat_w], -1)
        qvel = np.concatenate([qvel, obj.lin_vel_w, obj.ang_vel_b], -1)
    actions = np.zeros((FRAMES, JOINTS), np.float32)
    ids = (clips.motions[0].object_id,), ("clip",)
    starts = np.array([0, FRAMES])
    named = (ROBOT.name, clips.task.name, 50.0, ROBOT.joint_names)
    return Demos(*named, starts, None, actions, actions, qpos, qvel, *ids, np.ones(1, bool))


@pytest.mark.parametrize("name", POSES)
@pytest.mark.parametrize("design", [name for name in TRACKERS.names() if name != "residual-contact"])
def test_poses_complete_what_the_tracker_is_told(name, design):
    """By differences and forward kinematics, in the middle of a clip, beside it."""
    clips = gliding(TASKS.get(name))
    demos, spec, at = followed(clips), TRACKERS.get(design), 20
    chunk = ClipPlans(demos, clips).of(torch.tensor([at]), torch.arange(at, at + 6)[None])
    assert chunk.shape == (1, 6, PosePlan(ROBOT, clips.task).size)
    bank = ReferenceBank(clips.motions, ROBOT)
    env = VecEnv(clips.task, ROBOT, clips.scenes, ONE, bank=bank)
    start = ClipStarts(bank, env.physics.add_objects(clips.scenes), ROBOT).at(torch.zeros(1).long(), torch.tensor([at]))
    state = start.robot
    root = torch.tensor(demos.qpos[at : at + 1])
    velocity = torch.tensor(demos.qvel[at : at + 1])
    body = replace(
        state,
        root_pos_w=root[:, :3],
        root_quat_w=root[:, 3:7],
        joint_pos=root[:, 7 : 7 + JOINTS],
        joint_vel=velocity[:, 6 : 6 + JOINTS],
    )
    moved = start.object
    if clips.task.moves_object:
        moved = replace(moved, pos_w=root[:, 7 + JOINTS : 10 + JOINTS])
    env.reset(Rows.every(1, env.device), replace(start, robot=body, object=moved))
    privileged = [term.name for term in chosen_terms(spec.observations, clips.task) if term.privileged]
    obs = env.observe(("proprio", *privileged, *(("targets",) if clips.task.wrist_goals else ())))
    found = PosePlan(ROBOT, clips.task).terms(spec, chunk, obs["proprio"])
    assert set(privileged) <= set(found)
    for term in found:
        # velocities are differences of two poses, and the clip's are those of its curve
        torch.testing.assert_close(found[term], obs[term].to(found[term].dtype), atol=0.02, rtol=0.02)
        close = (found[term] - obs[term]).abs() < 2e-4
        assert close.float().mean() > 0.7 or term == "walk+1", term  # which is velocities and nothing else


def test_plans_of_the_frames_to_come():
    """Worked out by hand: a robot at (1, 2, 0) turned left by 90 degrees, references one and two steps along x."""
    clips = gliding(TASKS.get("sit-chair"))
    demos, bank = followed(clips), ReferenceBank(clips.motions, ROBOT)
    demos.qpos[:, :7] = [1.0, 2.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    plan = ClipPlans(demos, clips).of(torch.tensor([5]), torch.tensor([[5, 8, FRAMES - 1]]))[0]
    size = 2 * JOINTS + 9
    for slot, (first, second) in enumerate([(6, 7), (9, 10), (FRAMES - 1, FRAMES - 1)]):
        then = plan[slot, :size] + CONTROL_DT * plan[slot, size:]
        for part, index in ((plan[slot, :size], first), (then, second)):
            frame = bank.frame(torch.tensor([0]), torch.tensor([index]))
            x, y, z = frame.root_pos_w[0].tolist()
            torch.testing.assert_close(part[-9:-6], torch.tensor([y - 2, 1 - x, z]), atol=1e-5, rtol=0)
            torch.testing.assert_close(part[:JOINTS], frame.joint_pos[0])
            torch.testing.assert_close(part[JOINTS : 2 * JOINTS], frame.joint_vel[0])
    assert plan.shape == (3, 94), "47 numbers of each of two frames"


@pytest.mark.parametrize("name", POSES)
def test_what_demonstrations_did_themselves(name):
    """Their own motions say what the clip does where they follow it exactly, and what they did where they do not."""
    clips = gliding(TASKS.get(name))
    demos = followed(clips)
    own = motions_of(demos, clips)
    (motion,) = own.motions
    np.testing.assert_array_equal(motion.root_pos_w, demos.qpos[:, :3])
    np.testing.assert_array_equal(motion.joint_pos, demos.qpos[:, 7 : 7 + JOINTS])
    at, steps = torch.tensor([20]), torch.tensor([[20, 30]])
    said = ClipPlans(demos, own).of(at, steps)[0, :, 2 * JOINTS : 2 * JOINTS + 3]
    ahead = demos.qpos[[21, 31], :3] - demos.qpos[20, :3]
    expected = rot.rotate_inverse(np.tile(demos.qpos[20, 3:7], (2, 1)), ahead)
    np.testing.assert_allclose(said, expected, atol=1e-5)
    demos.qpos[:, :3] -= demos.qpos[:, :3] - clips.motions[0].root_pos_w
    demos.qpos[:, 3:7] = clips.motions[0].root_quat_w
    demos.qpos[:, 7 : 7 + JOINTS] = clips.motions[0].joint_pos
    if clips.task.moves_object:
        demos.qpos[:, 7 + JOINTS :] = np.concatenate([clips.motions[0].object_pos_w, clips.motions[0].object_quat_w], 1)
    exactly = ClipPlans(demos, motions_of(demos, clips)).of(at, steps)
    torch.testing.assert_close(exactly, ClipPlans(demos, clips).of(at, steps), atol=1e-4, rtol=1e-4)


def saved(folder, task, design, chunk=6):
    """A policy that has learned nothing, beside a tracker of some design."""
    network = replace(HITConfig.small(), encoder=TINY, hidden=16, heads=2, blocks=1, chunk=chunk).of(ROBOT, task)
    torch.manual_seed(0)
    save_learner(folder / "policy", network.build(), ROBOT.name)
    shape = shape_of(design, task)
    save_checkpoint(folder / "tracker", "tracker", ROBOT.name, shape, tracker(shape).network.tensors())
    return folder / "policy"


@pytest.mark.parametrize("name", POSES)
def test_a_policy_drives_over_any_tracker(name, tmp_path):
    task = TASKS.get(name)
    clips = gliding(replace(task, time_limit=0.1))
    for design in ("hst", "residual", "hst-original"):
        policy = load_policy(saved(tmp_path / design, task, design), ROBOT, clips.task)
        assert policy.gains == TRACKERS.get(design).gains and "targets" not in policy.observations
        (run,) = run_policy(policy, clips, env_config=ONE)
        assert not run.errors and run.verdict.steps.tolist() == [5]


def test_who_says_poses_goes_on_from_what_was_done(tmp_path):
    """As an expert while somebody else drives."""
    clips = gliding(TASKS.get("sit-chair"))
    policy = load_policy(saved(tmp_path, clips.task, "residual"), ROBOT, clips.task)
    assert isinstance(policy, Corrigible)
    bank = ReferenceBank(clips.motions, ROBOT)
    env = VecEnv(clips.task, ROBOT, clips.scenes, ONE, bank=bank)
    starts = ClipStarts(bank, env.physics.add_objects(clips.scenes), ROBOT)
    env.reset(Rows.every(1, env.device), starts.at(torch.zeros(1).long(), torch.zeros(1).long()))
    obs = env.observe(policy.observations)
    policy.reset(torch.arange(1), obs)
    said = policy.act(obs)
    meant = policy.memory()["last_action"].clone()
    policy.drove(said)
    torch.testing.assert_close(policy.memory()["last_action"], meant, atol=1e-4, rtol=1e-4)
    policy.drove(said + 0.05)
    assert (policy.memory()["last_action"] - meant).abs().min() > 0.05


def test_a_tracker_that_looks_too_far_ahead_is_refused(tmp_path):
    task = TASKS.get("sit-chair")
    folder = saved(tmp_path, task, "residual", chunk=3)
    with pytest.raises(MimicbenchError, match="looks 5 frames ahead, but the plans end after 3"):
        load_hit(folder, ROBOT, task)
    short = HITImitation(network=replace(HITConfig.small(), chunk=3))
    with pytest.raises(MimicbenchError, match="looks 5 frames ahead, but the plans end after 3"):
        learn(folder, Given(gliding(task), tmp_path / "no demonstrations", 0, "full", RunContext()), short)


def test_a_tracker_that_is_told_what_bears_is_refused(tmp_path):
    task = TASKS.get("sit-chair")
    with pytest.raises(MimicbenchError, match="do not say what bears"):
        load_hit(saved(tmp_path, task, "residual-contact"), ROBOT, task)


def test_a_policy_without_its_tracker_is_refused(tmp_path):
    folder = saved(tmp_path, TASKS.get("sit-chair"), "hst")
    (tmp_path / "tracker" / "config.json").unlink()
    with pytest.raises(MimicbenchError, match="tracker"):
        load_hit(folder, ROBOT, TASKS.get("sit-chair"))
    assert json.loads((folder / "config.json").read_text())["kind"] == "hit"
