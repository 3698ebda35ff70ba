"""Retargeting that keeps the interaction: contacts, feet that stand, a body that neither enters the furniture nor
loses its balance.

Plain least squares over the whole clip: half the sum of (residual / tolerance)^2, where a residual is

    bodies      link - followed point, and the rotation from the human's limb to the robot's    (tables of appendix B.1)
    feet        foot - its anchor: still, flat and on the floor from touch-down to lift-off
    hands       wrist - its anchor: the wrist's goal, or the place on the object that the human's palm holds
    contacts    distance of the bearing part (pelvis, back) from the surface, in frames that label it
    clearance   depth of every collision shape in floor and object, and in the robot's own other parts
    balance     how far the center of mass is in front of or behind both standing feet, while they alone bear, or behind
                where the root bears who swings the legs up, until the hands bear, too
    smoothness  accelerations of root and joints; joint velocities beyond their limit

with joint limits exact. The literature finds that contacts and penetration decide what a controller can track
(OmniRetarget; holosoma); the three methods of the paper know neither.
"""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.references.curves import smooth_above
from mimicbench.retarget.acceptance import PROMISED
from mimicbench.retarget.clip import Clip, storable
from mimicbench.retarget.kinematics import Pose, Tree, tree_of
from mimicbench.retarget.mapping import Bound, find_mapping, followed_points
from mimicbench.retarget.method import Method
from mimicbench.retarget.methods.anchors import Anchors, anchors_of
from mimicbench.retarget.methods.copy_rotation import copy_rotations
from mimicbench.retarget.methods.interaction_config import LYING, InteractionConfig
from mimicbench.retarget.methods.interaction_loss import Problem
from mimicbench.retarget.methods.support import support_of
from mimicbench.retarget.samples import FAR, Masses, Scene, balls_of
from mimicbench.retarget.self_contact import SelfContact
from mimicbench.retarget.solver import solve
from mimicbench.retarget.trunk import bears, ends_lying, swung, trunk_rests, trunk_up
from mimicbench.robots.description import Robot

MOST_BACK = 0.2
"""[m] Whoever leans back is put at most so much farther back, or forward, than the person."""
EDGE = 0.015
"""[m] Whoever slides forward on a seat stays so far behind its front."""


def interact(clip: Clip, config: InteractionConfig | None = None) -> RobotMotion:
    """The robot motion that does with the object what the human does. Raises UnknownName or BadMotion."""
    config = config or (LYING if ends_lying(clip.motion) else InteractionConfig())
    step = max(1, min(round(clip.motion.fps / config.rough_fps), clip.motion.frames // 4))
    rough, shifts = _settled(
        replace(clip, motion=clip.motion.thinned(step)), replace(config, tolerance=config.rough_tolerance)
    )
    problem, _ = make_problem(clip, config, *shifts)
    pose, losses = _solved(problem, refine(rough, step, clip.motion.frames))
    return clip.finished(
        problem.tree, pose, clip.bind("improved"), {"loss": losses[-1], "iterations": float(len(losses) - 1)}
    )


def _settled(clip: Clip, config: InteractionConfig) -> tuple[Pose, tuple[float, float, float]]:
    """The pose of a clip of few frames, how far who sits and who lies had to be put nearer to the feet for it [m],
    and how far who sits had to raise the heels [rad].
    """
    problem, start = make_problem(clip, config)
    sitting = lying = 0.0
    pose, losses = _solved(problem, start)
    distance = problem.clearance(pose)
    for slide in config.slides:
        sits, lies = problem.misplaced(distance)
        if not (sits or lies):
            break
        next_problem, moved = make_problem(clip, config, slide * sits, slide * lies)
        if np.abs(moved.root_pos - start.root_pos).max() < 1e-3:
            break  # at the edge
        problem, sitting, lying = next_problem, slide * sits, slide * lies
        pose = pose._replace(root_pos=pose.root_pos + moved.root_pos - start.root_pos)  # a head must get past the board
        pose, losses = _solved(problem, pose)
        start, distance = moved, problem.clearance(pose)
    if problem.stuck(distance):
        around, _ = _solved(problem.filled(), start)
        other, again = _solved(problem, around)
        pose = other if again[-1] < losses[-1] else pose
    heels, off = 0.0, problem.off(pose, distance)
    for raised in config.heels:
        if off < 1.0:
            break
        higher, start = make_problem(clip, config, sitting, lying, raised)
        other, _ = _solved(higher, start)
        if (found := higher.off(other, higher.clearance(other))) < off:
            pose, heels, off = other, raised, found
    return pose, (sitting, lying, heels)


def _solved(problem: Problem, start: Pose) -> tuple[Pose, list[float]]:
    """The pose of least loss, and the loss after each step."""
    config = problem.config
    return solve(problem, start, config.iterations, config.tolerance, config.patience)


def refine(pose: Pose, step: int, frames: int) -> Pose:
    """A pose of every `step`-th frame at all of them, smoothly."""
    from scipy.interpolate import CubicSpline

    known = step * np.arange(len(pose.joints))
    # q and -q are the same rotation: take those signs that change least
    flips = np.concatenate(
        [[1.0], np.cumprod(np.where((pose.root_quat[1:] * pose.root_quat[:-1]).sum(-1) < 0, -1.0, 1.0))]
    )
    wanted = np.minimum(np.arange(frames), known[-1])
    root_pos, root_quat, joints = (
        CubicSpline(known, values)(wanted) for values in (pose.root_pos, pose.root_quat * flips[:, None], pose.joints)
    )
    return Pose(root_pos, rot.normalize(root_quat), joints)


def make_problem(
    clip: Clip, config: InteractionConfig, sitting: float = 0.0, lying: float = 0.0, heels: float = 0.0
) -> tuple[Problem, Pose]:
    """Targets and tolerances of a clip, and a pose to start from.

    Whoever sits or lies is to do so that much [m] nearer to its feet; who sits has the heels raised by so much [rad].
    """
    motion, robot = clip.motion, clip.robot
    mapping = find_mapping(motion.skeleton.name, robot)
    bound = clip.bind("improved")
    tree, limits = tree_of(robot), storable(robot.joint_range)
    pos_w, quat_w = motion.forward_kinematics()
    anchors = anchors_of(clip, mapping, bound, pos_w, quat_w, heels)
    feet = [link for _, link in bound.feet]
    wrist_links = np.array([link for _, link, _ in bound.wrists])
    wrist_points = np.array([point for *_, point in bound.wrists])
    targets, tolerance = _points(bound, config, anchors, followed_points(bound, pos_w, quat_w))
    near, far = config.hand
    hand = far * (near / far) ** anchors.nearness  # from far to near by equal ratios
    balls = balls_of(robot)
    support = support_of(clip, mapping, balls, anchors, config)
    seated, lies = support.seated, support.lying
    turn_links, turn_targets, turn_tolerance = _turns(clip, bound, config, anchors, quat_w, support.perched)
    to_feet = (support.ankles - targets[:, bound.links.tolist().index(0)]) * [1.0, 1.0, 0.0]
    to_feet /= np.maximum(np.linalg.norm(to_feet, axis=-1, keepdims=True), 0.1)
    sitting = min(sitting, _room(clip, targets[seated, bound.links.tolist().index(0)], to_feet[seated]))
    forward = (sitting * _eased(seated, motion.fps) + lying * _eased(lies, motion.fps))[:, None] * to_feet
    start = copy_rotations(bound, tree, limits, pos_w, quat_w)
    start = start._replace(root_pos=start.root_pos - anchors.lowering[:, None] * np.array([0.0, 0.0, 1.0]))
    forward += _to_back(clip, tree, start, seated & bears(motion, "back"))
    targets[:, ~np.isin(bound.links, feet)] += forward[:, None]
    start = start._replace(root_pos=start.root_pos + forward)
    return Problem(
        tree,
        limits,
        config,
        motion.fps,
        np.concatenate([bound.links, wrist_links]),
        np.concatenate([np.zeros((len(bound.links), 3)), wrist_points]),
        np.concatenate([targets, anchors.hand_pos_w], 1),
        np.concatenate([tolerance, hand], 1) ** -2,
        turn_links,
        turn_targets,
        turn_tolerance**-2,
        balls,
        support,
        Scene.of(motion, clip.obj),
        SelfContact.of(robot, balls),
        Masses.of(robot),
        config.velocity_share * robot.velocity_limit,
        _legs(robot, feet),
    ), start


def _points(
    bound: Bound, config: InteractionConfig, anchors: Anchors, targets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Followed points (T, P, 3) [m], the feet's at their anchors and the others lowered, and tolerances (T, P) [m]."""
    targets = targets.copy()
    feet = [link for _, link in bound.feet]
    tolerance = np.full(targets.shape[:2], config.position)
    others = ~np.isin(bound.links, feet)
    targets[:, others, 2] -= anchors.lowering[:, None] * bound.lowered[others]
    for foot, link in enumerate(feet):
        column = bound.links.tolist().index(link)
        targets[:, column] = anchors.foot_pos_w[:, foot]
        rests = np.where(anchors.standing[:, foot], config.foot_rest, config.foot[1])
        tolerance[:, column] = np.where(anchors.on_floor[:, foot], config.foot[0], rests)
    return targets, tolerance


def _turns(
    clip: Clip, bound: Bound, config: InteractionConfig, anchors: Anchors, quat_w: np.ndarray, perched: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Links (Q,) that turn as the joints (T, J, 4) do, their targets (T, Q, 4) and tolerances (T, Q) [rad]."""
    feet = [link for _, link in bound.feet]
    turns, first = np.unique(np.stack([bound.turn_joints, bound.turn_links], -1), axis=0, return_index=True)
    turn_targets = rot.multiply(quat_w[:, turns[:, 0]], bound.turn_offsets[first])
    turn_tolerance = np.full(turn_targets.shape[:2], config.orientation)
    for foot, link in enumerate(feet):
        column = turns[:, 1].tolist().index(link)
        turn_targets[:, column] = anchors.foot_quat_w[:, foot]
        turn_tolerance[:, column] = np.where(anchors.on_floor[:, foot], *config.foot_turn)
    _keep_lean(clip, config, turns[:, 1], turn_targets, turn_tolerance, trunk_rests(clip.motion) & ~perched)
    return turns[:, 1], turn_targets, turn_tolerance


def _keep_lean(
    clip: Clip,
    config: InteractionConfig,
    links: np.ndarray,
    targets: np.ndarray,
    tolerance: np.ndarray,
    when: np.ndarray,
) -> None:
    """Let the trunk lean as the person's does in the frames `when` (T,), in targets (T, Q, 4) and tolerances (T, Q)
    of links (Q,).

    A robot without a waist would lean somewhere between pelvis and chest, or as its arms and feet would have it.
    """
    motion, robot = clip.motion, clip.robot
    mapping = find_mapping(motion.skeleton.name, robot)
    share, up = _eased(when, motion.fps), trunk_up(motion)
    for column in np.flatnonzero(np.isin(links, [0, robot.link_names.index(mapping.trunk)])):
        targets[:, column] = rot.slerp(targets[:, column], swung(targets[:, column], up), share)
        tolerance[:, column] *= (config.lean / config.orientation) ** share


def _to_back(clip: Clip, tree: Tree, start: Pose, leans: np.ndarray) -> np.ndarray:
    """(T, 3) how far a robot has to be moved for its trunk to meet what the person leans back against [m].

    People slump: the pelvis is far in front of what the shoulders touch, where a straight trunk would have to lean
    farther than theirs does. In the frames `leans` (T,) it is to lean as far, farther back on the seat.
    """
    frames, motion = np.flatnonzero(leans)[::3], clip.motion
    if not len(frames):
        return np.zeros((len(leans), 3))
    pose = Pose(start.root_pos[frames], swung(start.root_quat[frames], trunk_up(motion)[frames]), start.joints[frames])
    facing = rot.rotate(pose.root_quat, np.array([1.0, 0.0, 0.0])).mean(0) * [1.0, 1.0, 0.0]
    facing /= np.linalg.norm(facing)
    balls, scene = balls_of(clip.robot), Scene.of(motion, clip.obj)
    mapping = find_mapping(motion.skeleton.name, clip.robot)
    trunk = balls.link == clip.robot.link_names.index(mapping.trunk)
    centers = balls.place(tree.place(pose))[:, trunk]
    back = 0.0
    for _ in range(3):
        points = (centers - back * facing).reshape(-1, 3)
        away, _ = scene.object_distance(np.repeat(frames, trunk.sum()), points)
        gap = np.minimum(away.reshape(len(frames), -1) - balls.radius[trunk], FAR).min(-1)
        back = float(np.clip(back + np.median(gap), -MOST_BACK, MOST_BACK))
    return -back * _eased(leans, motion.fps)[:, None] * facing


def _room(clip: Clip, pelvis_w: np.ndarray, way: np.ndarray) -> float:
    """How far seated pelvises (n, 3) may go along directions (n, 3) and still be over the object, with EDGE to spare
    [m].
    """
    low, high = clip.obj.bounds()
    room = np.where(way > 0, high - EDGE - pelvis_w, pelvis_w - low - EDGE) / np.maximum(np.abs(way), 1e-6)
    return max(0.0, float(room[:, :2].min(initial=np.inf)))


def _legs(robot: Robot, feet: list[int]) -> np.ndarray:
    """(L,) whether a link is a foot or between a foot and the root."""
    leg = np.zeros(len(robot.links), bool)
    for link in feet:
        while link > 0:
            leg[link], link = True, robot.link_parents[link]
    return leg


def _eased(when: np.ndarray, fps: float) -> np.ndarray:
    """(T,) 1 in the frames `when` (T,), rising to it in the second before them and falling in the second after."""
    return smooth_above(when.astype(float), max(1, round(0.5 * fps)))


METHOD = Method("interaction", "Interaction (ours)", lambda clip, _: interact(clip), ("improved",), PROMISED)
