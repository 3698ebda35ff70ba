"""Plans tried out in the mind: the tracker follows each beside the stand-in, in physics of its own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.online.planning import Planned
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.tasks.task import BodyPoints, ObjectInfo, Task
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.tracker import Tracker

ASTRAY = 0.2
"""[m] Who ends farther from the plan with pelvis or an ankle does not do what was planned, though K may hold beside
the stand-in, which has less to hang over, or to stay below, than what it stands for."""
GRADE = 0.02
"""[m] Ends whose room differs by less are alike."""


def choose(
    tracker: Tracker,
    robot: Robot,
    task: Task,
    found: Sequence[Sequence[Planned]],
    most: float = 0.0,
    device: str = "cpu",
) -> list[Planned]:
    """Of each robot's plans the one that goes best in the mind, or the only one; see `rehearse`."""
    tried = [plan for plans in found if len(plans) > 1 for plan in plans]
    worth = iter(rehearse(tracker, robot, task, tried, most, device) if tried else ())
    chosen = []
    for plans in found:
        scores = [next(worth) for _ in plans] if len(plans) > 1 else [(False, False, 0.0, 0.0)]
        chosen.append(plans[scores.index(max(scores))])
    return chosen


def rehearse(
    tracker: Tracker, robot: Robot, task: Task, plans: Sequence[Planned], most: float = 0.0, device: str = "cpu"
) -> list[tuple[bool, bool, float, float]]:
    """Follow every plan to the time limit.

    Returns:
        For each what speaks for it, to be compared as it is: whether the robot stays, near to where the plan ends;
        whether it fulfils K; how much room K has in the end, at most `most`, in grades [m]; and the negative peak of
        effort that P limits [W^2].
    """
    objects = [replace(plan.stand_in, id=f"stand-in-{i}") for i, plan in enumerate(plans)]
    motions = [replace(plan.motion, object_id=obj.id) for plan, obj in zip(plans, objects, strict=True)]
    clips = ClipSet(task, robot, motions, {obj.id: obj for obj in objects})
    rollout = track_clips(tracker, clips, RolloutConfig(settle=None, leave_fallen=True), EnvConfig(device))
    verdict, ends = rollout.verdict, rollout.last_qpos
    there = np.array([strayed(robot, motion, qpos) for motion, qpos in zip(motions, ends, strict=True)]) < ASTRAY
    stays = verdict.stays.cpu().numpy() & there
    effort, scenes = verdict.effort.cpu().numpy(), zip(motions, objects, ends, strict=True)
    rooms = [GRADE * np.floor(min(room(task, robot, *scene), most) / GRADE) if most else 0.0 for scene in scenes]
    return [(bool(stays[i]), bool(verdict.success[i]), float(rooms[i]), -float(effort[i])) for i in range(len(plans))]


def room(task: Task, robot: Robot, motion: RobotMotion, obj: SceneObject, qpos: np.ndarray) -> float:
    """By how much [m] the condition of K holds beside an object, with the robot (and the object) at (nq,) qpos; what it
    lacks, as a negative number, where it does not.
    """
    joints = 7 + len(robot.joints)
    points = robot.forward_kinematics(qpos[None, :3], qpos[None, 3:7], qpos[None, 7:joints])
    info = ObjectInfo.of([obj], [motion.wrist_goal_w])
    if task.moves_object:
        info = info.moved(qpos[None, joints : joints + 3], qpos[None, joints + 3 : joints + 7])
    body = BodyPoints.of(robot, *points)
    return -float(np.nanmax([part.measure(body, info) for part in task.shortfalls]))


def strayed(robot: Robot, motion: RobotMotion, qpos: np.ndarray) -> float:
    """How far pelvis and ankles are from where a plan ends [m], at the most, with the robot at (nq,) qpos."""
    joints = len(robot.joints)
    now = robot.forward_kinematics(qpos[:3], qpos[3:7], qpos[7 : 7 + joints])
    then = robot.forward_kinematics(motion.root_pos_w[-1], motion.root_quat_w[-1], motion.joint_pos[-1])
    here, planned = (BodyPoints.of(robot, *(part[None] for part in links)) for links in (now, then))
    ankles = np.linalg.norm(here.ankle_pos_w - planned.ankle_pos_w, axis=-1).max()
    return max(float(ankles), float(np.linalg.norm(here.pelvis_pos_w - planned.pelvis_pos_w)))
