"""What tests of trackers start from: motions with known derivatives, robots where their references are."""

from dataclasses import replace

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.sensors.context import StepContext, Transition
from mimicbench.sensors.observations import TERMS
from mimicbench.sensors.pictures import CameraPictures
from mimicbench.sensors.reference import reference_links
from mimicbench.sim.physics import RobotState
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import TrackerConfig, build_tracker
from mimicbench.track.learning.ppo import PPOConfig
from mimicbench.track.network import MLPConfig
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import TrackConfig, TrackingConfig
from mimicbench.track.tracker import Layout, flat
from mimicbench.track.trackers import hst, residual
from stool import H1, block, seated, standing

SIT_CHAIR, LIFT_BOX, TOUCH = (TASKS.get(name) for name in ("sit-chair", "lift-box", "touch-points"))
STOOL = block()
OBJECTS = {STOOL.id: STOOL}
CALM = TrackingConfig(ClipStartConfig(1.0, 0.0, 0.0, 0.0), push=0.0, hold=0.0)
ONE_THREAD = EnvConfig(workers=1)
TINY = PPOConfig(hidden=(16,), steps=8, epochs=1, minibatches=2)
RATES = np.linspace(-0.4, 0.4, 19)
RESIDUAL, HST, PHC = (TRACKERS.get(name) for name in ("residual", "hst", "phc"))
OURS, PAPERS = residual.ResidualConfig(), hst.HSTConfig()
LAYOUT = Layout.of(RESIDUAL, H1, [SIT_CHAIR])
"""What our tracker sees at sit-chair."""


def swing(name="swing", frames=41, fps=30.0):
    """A motion with known derivatives: the root on a circle of 1 m at 0.5 rad/s, turning as it goes.

    Joints swing about the rest pose.
    """
    t = np.arange(frames) / fps
    pos = np.stack([np.cos(0.5 * t) - 2.5, np.sin(0.5 * t), 1.0 + 0 * t], -1)
    joints = np.array(H1.rest_pose) + 0.05 * np.sin(t[:, None] * 2 + RATES)
    quat = rot.from_yaw(0.5 * t)
    quat[::2] *= -1  # the same turns, written the other way round
    return RobotMotion(name, "sit-chair", "h1", H1.joint_names, fps, pos, quat, joints, STOOL.id, name)


def still(posture, name, frames=40):
    """A motion that stays as it is."""
    pos, joints = posture
    return RobotMotion(
        name,
        "sit-chair",
        "h1",
        H1.joint_names,
        50.0,
        np.tile(pos, (frames, 1)),
        np.tile(rot.IDENTITY, (frames, 1)),
        np.tile(joints, (frames, 1)),
        STOOL.id,
        name,
    )


CLIPS = [still(standing(), "stands"), still(seated(0.42), "sits")]


def clip_set(*motions):
    return ClipSet(SIT_CHAIR, H1, list(motions) or CLIPS, OBJECTS)


def idle():
    """A tracker that leaves the reference as it is."""
    network = LAYOUT.blueprint(MLPConfig((4,))).network(19)
    for parameter in network.parameters():
        parameter.data.zero_()
    return build_tracker(TrackerConfig("residual", LAYOUT.names, LAYOUT.widths, 19, (4,)), network.tensors())


def state_of(frame):
    """A robot that is exactly where its reference is."""
    spin = rot.rotate_inverse(frame.root_quat_w, frame.root_ang_vel_w)
    return RobotState(frame.root_pos_w, frame.root_quat_w, frame.root_lin_vel_w, spin, frame.joint_pos, frame.joint_vel)


class FakePhysics:
    """Nothing but where links and objects are, and what touches links."""

    def __init__(self, links, obj, forces=None):
        self._links, self._object, self._forces = links, obj, forces

    def contact_force(self):
        return self._forces

    def links(self):
        return self._links

    link_poses = links

    def object_state(self):
        return self._object


def context_of(bank, index, state=None, task=SIT_CHAIR, obj=None, last_action=0.0):
    """A robot at a frame of the bank's first clip, where the reference is unless it is given a state."""
    clip, at = torch.zeros(1, dtype=torch.long), torch.tensor([index])
    frame = bank.frame(clip, at)
    physics = FakePhysics(reference_links(H1, frame), obj or frame.object)
    return StepContext(
        robot=H1,
        task=task,
        physics=physics,
        state=state or state_of(frame),
        time=torch.zeros(1),
        odometry_pos=torch.zeros(1, 2),
        odometry_yaw=torch.zeros(1),
        last_action=torch.full((1, 19), last_action),
        last_target=torch.zeros(1, 19),
        wrist_goal_w=frame.wrist_goal_w,
        reference=lambda k: bank.frame(clip, at + k),
        pictures=CameraPictures(H1, task.rig, 16, 16),
    )


def observed(spec, context):
    names = Layout.of(spec, H1, [context.task]).names
    return flat({name: TERMS[name].compute(context) for name in names}, names)


def moved_on(bank, context, index=9, action=0.0, previous=0.0):
    """A step that led to `context` from one frame before, with a change of the action and nothing else."""
    before = replace(context_of(bank, index, last_action=previous), state=context.state)
    return Transition(torch.full((1, 19), action), before, torch.zeros(1))


def lifted(frames=41):
    """A box that goes up with the robot standing behind it, turning about the vertical."""
    t = np.arange(frames) / 30.0
    pos = np.stack([0.3 + 0 * t, 0 * t, 0.2 * t], -1)
    return replace(swing(frames=frames), task="lift-box", object_pos_w=pos, object_quat_w=rot.from_yaw(0.3 * t))


def shifted(context, away):
    """The same robot with all its links elsewhere."""
    links = context.physics.links()
    physics = FakePhysics(replace(links, pos_w=links.pos_w + torch.tensor(away)), context.physics.object_state())
    return replace(context, physics=physics)


def tiny(rounds):
    """A training of so many rounds."""
    return TrackConfig(
        samples=rounds * 8 * TINY.steps, num_envs=8, evaluate_clips=2, ppo=TINY, save_every=0.0, evaluate_every=10**9
    )
