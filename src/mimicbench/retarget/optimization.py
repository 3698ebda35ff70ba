"""Retargeting by optimization (paper section 4.1, appendix B.2), solved as the banded least squares problem that it is.

State: M = {root orientation R, root position t, joint angles J} in all T frames. Loss (mean over frames and pairs):

    L = l_pos mean w |p - p*|^2 + l_hand mean |wrist - wrist*|^2 + l_ori mean angle(q, q*) + l_acc mean |d2J/dt2|
        + l_root mean |d2t/dt2| + l_floor mean min(0, sole height)^2          (the last two are ours; 0 gives the paper's loss)

The paper minimizes it by 3000 steps of Adam. Here every absolute value |x| is majorized by x^2 / (2 c) + c / 2 with
c = sqrt(x^2 + eps^2) at the present x (iteratively reweighted least squares), and each Gauss-Newton step solves one
linear system. Frames meet only in the accelerations, which join one coordinate at t - 1, t, t + 1: the matrix is
block-diagonal plus two diagonals, so a banded Cholesky factorization costs the same for each frame, however long the
clip. Joint limits hold exactly: joints that would leave them are held at them and the others solved for again.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.retarget.copy_rotation import copy_rotations
from mimicbench.retarget.grounding import ground, stance
from mimicbench.retarget.kinematics import Jacobian, Links, Pose, Tree, tree_of
from mimicbench.retarget.mapping import Bound, Preset, bind, find_mapping, followed_points
from mimicbench.retarget.measures import measure
from mimicbench.robot.description import Robot

_CHUNK = 256  # frames whose Jacobians are held at a time: 5 MB, which stays in the cache


@dataclass(frozen=True)
class OptimizationConfig:
    """Weights of the loss and when to stop."""

    preset: Preset = "improved"
    """`paper`: the table to the letter; `improved`: points and orientations of the two bodies that correspond, feet first (see mapping.py)."""
    position: float = 1.0
    """l_pos [1/m^2]. The unit that the others are measured in."""
    hand: float = 0.0
    """l_hand [1/m^2]; the tasks touch-points and lift-box use it (5), no other does."""
    orientation: float = 0.03
    """l_ori [1/rad]. An error of 5 cm at the end of a limb of 0.3 m pulls with 2 * 0.05 * 0.3 = 0.03 per radian: up to that much the limbs keep the
    human's directions and leave the difference in length; beyond it, and always at the much heavier feet, the place counts more."""
    acceleration: float = 1e-4
    """l_acc [s^2/rad]. A walk has about 10 rad/s^2 in the mean; a reduction of 1 rad/s^2 may cost 0.002 rad of orientation: jitter goes, the gait stays."""
    root_acceleration: float = 3e-4
    """l_root [s^2/m]: without it the root takes up what the smooth joints leave over, as in recordings with repeated frames. A walk has about 2 m/s^2.
    0 in the paper."""
    floor: float = 200.0
    """l_floor [1/m^2]: the H1's foot is longer than the human's, its toe would enter the floor when the heel rises. 0 in the paper."""
    softness: tuple[float, float, float] = (0.01, 1.0, 0.3)
    """eps of the absolute values: orientation [rad], joint acceleration [rad/s^2] and root acceleration [m/s^2]."""
    iterations: int = 30
    """Gauss-Newton steps at most."""
    tolerance: float = 1e-4
    """Stop when a step lowers the loss by less than this part of it."""


PAPER = OptimizationConfig(preset="paper", root_acceleration=0.0, floor=0.0)
"""The appendix's loss and table to the letter (but for the weights, which it does not tell)."""


class Problem(NamedTuple):
    """Everything that stays fixed during the solution."""

    tree: Tree
    limits: np.ndarray
    """(N, 2) [rad]."""
    fps: float
    point_links: np.ndarray
    """(P,) links of the points: pairs, wrists, soles."""
    point_offsets: np.ndarray
    """(P, 3) in the link frame [m]."""
    point_targets: np.ndarray
    """(T, P, 3) [m]; of soles only the height counts, it is a lower bound."""
    point_weights: np.ndarray
    """(P,) weight of the squared error in the summed loss."""
    soles: int
    """How many of the points, the last ones, are soles."""
    turn_links: np.ndarray
    """(Q,) links of the orientations."""
    turn_targets: np.ndarray
    """(T, Q, 4)."""
    turn_weights: np.ndarray
    """(Q,) weight of the angle in the summed loss."""
    acceleration_weights: np.ndarray
    """(3 + N,) weight of each |d2t/dt2| and |d2J/dt2| in the summed loss."""
    softness: float
    """eps of the orientations [rad]."""
    acceleration_softness: np.ndarray
    """(3 + N,) eps of the accelerations [m/s^2], [rad/s^2]."""


def retarget_clip(motion: HumanMotion, robot: Robot, config: OptimizationConfig | None = None, success: bool = True) -> RobotMotion:
    """The robot's version of a human clip: same id, frame rate, object, contacts and style, joint limits kept.

    Args:
        motion: Clip on a skeleton that has a mapping to the robot.
        robot: Target.
        config: Weights and stopping rule.
        success: What to note in the result; judge it afterwards with the task's metric and `dataclasses.replace`.

    Raises:
        UnknownName: There is no mapping from this skeleton to this robot.
        BadMotion: The skeleton or the robot lacks something that the mapping names.
    """
    config = config or OptimizationConfig()
    mapping = find_mapping(motion.skeleton.name, robot.name)
    bound = bind(mapping, motion.skeleton, robot, config.preset)
    pos_w, quat_w = motion.forward_kinematics()
    tree, limits = tree_of(robot), _storable(robot.joint_range)
    problem = make_problem(bound, tree, limits, pos_w, quat_w, motion.fps, config)
    pose, losses = solve(problem, copy_rotations(bound, tree, limits, pos_w, quat_w), config.iterations, config.tolerance)
    standing = stance(motion, bound, pos_w[:, [joint for joint, _ in bound.feet]])
    pose = pose._replace(root_pos=pose.root_pos + [0.0, 0.0, ground(tree.place(pose), bound, standing)])
    links = tree.place(pose)
    measures = {**measure(links, pose, bound, robot, pos_w, quat_w, motion.fps, standing), "loss": losses[-1], "iterations": float(len(losses) - 1)}
    return RobotMotion(
        id=motion.id, task=motion.task, robot=robot.name, joint_names=robot.joint_names, fps=motion.fps, root_pos_w=pose.root_pos,
        root_quat_w=pose.root_quat, joint_pos=pose.joints, object_id=motion.object_id, reference_id=motion.id,
        contact_names=motion.contact_names, contacts=motion.contacts, style=motion.style, measures=measures, success=success,
    )  # fmt: skip


def _storable(limits: np.ndarray) -> np.ndarray:
    """Limits (N, 2) a hair narrower, for files keep single precision and what they round must not exceed a limit."""
    return np.nextafter(limits.astype(np.float32), np.float32(limits.mean(1, keepdims=True))).astype(float)


def make_problem(bound: Bound, tree: Tree, limits: np.ndarray, pos_w: np.ndarray, quat_w: np.ndarray, fps: float, config: OptimizationConfig) -> Problem:
    """Targets and weights from the human's joint poses (T, J, 3) and (T, J, 4)."""
    frames, pairs = len(pos_w), len(bound.links)
    links, offsets = [bound.links], [np.zeros((pairs, 3))]
    targets = [followed_points(bound, pos_w, quat_w)]
    weights = [config.position * bound.weights / (frames * pairs)]
    if config.hand > 0:
        joints, wrist_links, points = zip(*bound.wrists, strict=True)
        links.append(np.array(wrist_links))
        offsets.append(np.array(points))
        targets.append(pos_w[:, list(joints)])
        weights.append(np.full(len(joints), config.hand / (frames * len(joints))))
    soles = len(bound.feet) * len(bound.sole) if config.floor > 0 else 0
    if soles:
        links.append(np.repeat([link for _, link in bound.feet], len(bound.sole)))
        offsets.append(np.tile(bound.sole, (len(bound.feet), 1)))
        targets.append(np.zeros((frames, soles, 3)))
        weights.append(np.full(soles, config.floor / (frames * soles)))
    # Two of the table's links may have the same carrier: one row of twice the weight instead of two.
    turns, first, counts = np.unique(np.stack([bound.turn_joints, bound.turn_links], -1), axis=0, return_index=True, return_counts=True)
    return Problem(
        tree, limits, fps, np.concatenate(links), np.concatenate(offsets), np.concatenate(targets, 1), np.concatenate(weights), soles,
        turns[:, 1], rot.multiply(quat_w[:, turns[:, 0]], bound.turn_offsets[first]), config.orientation * counts / (frames * pairs),
        np.repeat([config.root_acceleration / 3, config.acceleration / len(limits)], [3, len(limits)]) / max(1, frames - 2),
        config.softness[0], np.repeat(config.softness[2:0:-1], [3, len(limits)]),
    )  # fmt: skip


def solve(problem: Problem, start: Pose, iterations: int, tolerance: float) -> tuple[Pose, list[float]]:
    """Minimize from a start within the limits. Returns the state and the loss (absolute values softened) after each step taken."""
    variables = 6 + len(problem.limits)
    jacobian = Jacobian(problem.tree, problem.point_links, problem.turn_links, min(_CHUNK, len(start.joints)))
    pose = start._replace(joints=np.clip(start.joints, problem.limits[:, 0], problem.limits[:, 1]))
    links = problem.tree.place(pose)
    losses, damping = [loss(problem, pose, links)], 1e-4
    for _ in range(iterations):
        band, gradient = _normal_equations(problem, pose, links, jacobian)
        while True:
            step = _bounded_step(band, gradient, damping, problem.limits, pose.joints)
            moved = _move(pose, step.reshape(-1, variables), problem.limits)
            moved_links = problem.tree.place(moved)
            value = loss(problem, moved, moved_links)
            if value < losses[-1] or damping > 1e6:
                break
            damping *= 10.0
        if value >= losses[-1]:
            break
        pose, links, damping = moved, moved_links, max(damping * 0.2, 1e-7)
        losses.append(value)
        if losses[-2] - value < tolerance * value:
            break
    return pose, losses


def loss(problem: Problem, pose: Pose, links: Links, softened: bool = True) -> float:
    """The loss L; with `softened`, |x| is sqrt(x^2 + eps^2)."""
    soft = float(softened)
    errors, turns, _ = _residuals(problem, links)
    total = ((errors**2).sum(-1) @ problem.point_weights).sum() + (_size((turns**2).sum(-1), soft * problem.softness) @ problem.turn_weights).sum()
    return float(total + (_size(_accelerations(problem, pose) ** 2, soft * problem.acceleration_softness) @ problem.acceleration_weights).sum())


def _size(squared: np.ndarray, softness: float | np.ndarray) -> np.ndarray:
    """The softened absolute value."""
    return np.sqrt(squared + softness**2)


def _residuals(problem: Problem, links: Links) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (T, P, 3) of the points [m], world rotation vectors (T, Q, 3) from target to link [rad], and the points (T, P, 3) themselves."""
    points = links.pos[:, problem.point_links] + rot.rotate(links.quat[:, problem.point_links], problem.point_offsets)
    errors = points - problem.point_targets
    if problem.soles:
        errors[:, -problem.soles :, :2] = 0.0
        errors[:, -problem.soles :, 2] = np.minimum(errors[:, -problem.soles :, 2], 0.0)
    return errors, rot.to_rotvec(rot.multiply(links.quat[:, problem.turn_links], rot.conjugate(problem.turn_targets))), points


def _accelerations(problem: Problem, pose: Pose) -> np.ndarray:
    """(T - 2, 3 + N) second differences of root position [m/s^2] and joint angles [rad/s^2]."""
    return np.diff(np.concatenate([pose.root_pos, pose.joints], 1), 2, axis=0) * problem.fps**2


def _normal_equations(problem: Problem, pose: Pose, links: Links, jacobian: Jacobian) -> tuple[np.ndarray, np.ndarray]:
    """Lower band (2 V + 1, T V) of the majorizer's matrix, and its gradient (T V,)."""
    frames, variables = len(pose.joints), 6 + len(problem.limits)
    errors, turns, points = _residuals(problem, links)
    point_weights = np.broadcast_to(2.0 * problem.point_weights[:, None], errors.shape).copy()
    if problem.soles:
        point_weights[:, -problem.soles :] *= errors[:, -problem.soles :] < 0
    turn_weights = np.repeat(problem.turn_weights / _size((turns**2).sum(-1), problem.softness), 3, axis=-1)
    # The gradient of half a squared angle is the rotation vector itself, and the identity bounds its second derivative: the Jacobian of the
    # logarithm is not needed.
    weights = np.concatenate([point_weights.reshape(frames, -1), turn_weights], 1)
    residuals = np.concatenate([errors.reshape(frames, -1), turns.reshape(frames, -1)], 1)
    blocks, gradient = np.empty((frames, variables, variables)), np.empty((frames, variables))
    for begin in range(0, frames, _CHUNK):
        part = slice(begin, begin + _CHUNK)
        rows = jacobian.fill(Links(links.pos[part], links.quat[part]), points[part])
        weighted = rows * weights[part, :, None]
        blocks[part] = np.swapaxes(weighted, 1, 2) @ rows
        gradient[part] = (residuals[part, None] @ weighted)[:, 0]
    band = np.zeros((2 * variables + 1, frames, variables))
    row, column = np.tril_indices(variables)
    band[row - column, :, column] = blocks[:, row, column].T
    if frames > 2:
        acceleration = _accelerations(problem, pose)
        weight = problem.acceleration_weights / _size(acceleration**2, problem.acceleration_softness)
        stencil = np.array([1.0, -2.0, 1.0]) * problem.fps**2
        smooth = np.r_[0:3, 6:variables]
        for i in range(3):
            gradient[i : frames - 2 + i, smooth] += stencil[i] * weight * acceleration
            for j in range(i, 3):
                band[(j - i) * variables, i : frames - 2 + i, smooth] += stencil[i] * stencil[j] * weight.T
    return band.reshape(2 * variables + 1, -1), gradient.ravel()


def _bounded_step(band: np.ndarray, gradient: np.ndarray, damping: float, limits: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """The damped Gauss-Newton step (T V,) that keeps the joints within their limits, by an active set."""
    damped = band.copy()
    damped[0] += damping * (band[0] + band[0].mean())
    low, high = np.full((len(joints), 6 + joints.shape[1]), -np.inf), np.full((len(joints), 6 + joints.shape[1]), np.inf)
    low[:, 6:], high[:, 6:] = limits[:, 0] - joints, limits[:, 1] - joints
    low, high = low.ravel(), high.ravel()
    held = ((low >= 0) & (gradient > 0)) | ((high <= 0) & (gradient < 0))
    step = np.zeros_like(gradient)
    for _ in range(4):
        try:
            step = _solve_with(damped, -gradient, held, step)
        except LinAlgError:
            return np.zeros_like(gradient)
        outside = (step < low) | (step > high)
        if not outside.any():
            break
        held = held | outside
        step = np.clip(step, low, high)
    return np.clip(step, low, high)


def _solve_with(band: np.ndarray, right: np.ndarray, held: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Solve the banded system for the free variables while the held ones keep their values."""
    if held.any():
        known, free = np.where(held, values, 0.0), ~held
        reduced, right = np.zeros_like(band), right - band[0] * known
        reduced[0] = np.where(held, 1.0, band[0])
        for k in range(1, len(band)):
            right[k:] -= band[k, :-k] * known[:-k]
            right[:-k] -= band[k, :-k] * known[k:]
            reduced[k, :-k] = band[k, :-k] * (free[k:] & free[:-k])
        band, right = reduced, np.where(held, values, right)
    return solveh_banded(band, right, lower=True, check_finite=False)


def _move(pose: Pose, step: np.ndarray, limits: np.ndarray) -> Pose:
    """The configuration after a change (T, V)."""
    quat = rot.normalize(rot.multiply(rot.from_rotvec(step[:, 3:6]), pose.root_quat))
    return Pose(pose.root_pos + step[:, :3], quat, np.clip(pose.joints + step[:, 6:], limits[:, 0], limits[:, 1]))
