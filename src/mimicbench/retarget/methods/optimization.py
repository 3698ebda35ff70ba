"""Retargeting by optimization (paper section 4.1, appendix B.2), solved as the banded least squares problem that it is.

State: M = {root orientation R, root position t, joint angles J} in all T frames. Loss (mean over frames and pairs):

    L = l_pos mean w |p - p*|^2 + l_hand mean |wrist - wrist*|^2 + l_ori mean angle(q, q*) + l_acc mean |d2J/dt2|
        + l_root mean |d2t/dt2| + l_floor mean min(0, sole height)^2          (the last two are ours; 0 gives the
        paper's loss)

The paper minimizes it by 3000 steps of Adam. Here every absolute value |x| is majorized by x^2 / (2 c) + c / 2 with
c = sqrt(x^2 + eps^2) at the present x (iteratively reweighted least squares), and each step solves one banded linear
system (solver.py).
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.retarget.clip import Clip, storable
from mimicbench.retarget.kinematics import Jacobian, Links, Pose, Tree, tree_of
from mimicbench.retarget.mapping import Bound, Preset, followed_points
from mimicbench.retarget.method import Method
from mimicbench.retarget.methods.copy_rotation import copy_rotations
from mimicbench.retarget.solver import Model, solve

_CHUNK = 256  # frames whose Jacobians are held at a time: 5 MB, which stays in the cache


@dataclass(frozen=True)
class OptimizationConfig:
    """Weights of the loss and when to stop."""

    preset: Preset = "improved"
    """`paper`: the table to the letter; `improved`: points and orientations of the two bodies that correspond, feet
    first (see mapping.py)."""
    position: float = 1.0
    """l_pos [1/m^2]. The unit that the others are measured in."""
    hand: float = 5.0
    """l_hand [1/m^2]; only counts where hands have something to do (touch-points, lift-box)."""
    orientation: float = 0.03
    """l_ori [1/rad]. An error of 5 cm at the end of a limb of 0.3 m pulls with 2 * 0.05 * 0.3 = 0.03 per radian: up to
    that much the limbs keep the human's directions and leave the difference in length; beyond it, and always at the
    much heavier feet, the place counts more."""
    acceleration: float = 1e-4
    """l_acc [s^2/rad]. A walk has about 10 rad/s^2 in the mean; a reduction of 1 rad/s^2 may cost 0.002 rad of
    orientation: jitter goes, the gait stays."""
    root_acceleration: float = 3e-4
    """l_root [s^2/m]: without it the root takes up what the smooth joints leave over, as in recordings with repeated
    frames. A walk has about 2 m/s^2. 0 in the paper."""
    floor: float = 200.0
    """l_floor [1/m^2]: the H1's foot is longer than the human's, its toe would enter the floor when the heel rises. 0
    in the paper."""
    softness: tuple[float, float, float] = (0.01, 1.0, 0.3)
    """eps of the absolute values: orientation [rad], joint acceleration [rad/s^2] and root acceleration [m/s^2]."""
    iterations: int = 30
    """Gauss-Newton steps at most."""
    tolerance: float = 1e-4
    """Stop when a step lowers the loss by less than this part of it."""


PAPER = OptimizationConfig(preset="paper", root_acceleration=0.0, floor=0.0)
"""The appendix's loss and table to the letter (but for the weights, which it does not tell)."""


@dataclass(frozen=True)
class Problem:
    """The loss of one clip: everything that stays fixed during the solution."""

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

    def loss(self, pose: Pose, links: Links, softened: bool = True) -> float:
        """The loss L; with `softened`, |x| is sqrt(x^2 + eps^2)."""
        soft = float(softened)
        errors, turns, _ = self._residuals(links)
        total = ((errors**2).sum(-1) @ self.point_weights).sum() + (
            _size((turns**2).sum(-1), soft * self.softness) @ self.turn_weights
        ).sum()
        return float(
            total
            + (
                _size(self._accelerations(pose) ** 2, soft * self.acceleration_softness) @ self.acceleration_weights
            ).sum()
        )

    def model(self, pose: Pose, links: Links) -> Model:
        """The majorizer at a pose."""
        frames, variables = len(pose.joints), 6 + len(self.limits)
        residuals, weights, points = self._weighted(links)
        blocks, gradient = np.empty((frames, variables, variables)), np.empty((frames, variables))
        jacobian = Jacobian(self.tree, self.point_links, self.turn_links, min(_CHUNK, frames))
        for begin in range(0, frames, _CHUNK):
            part = slice(begin, begin + _CHUNK)
            rows = jacobian.fill(Links(links.pos[part], links.quat[part]), points[part])
            weighted = rows * weights[part, :, None]
            blocks[part] = np.swapaxes(weighted, 1, 2) @ rows
            gradient[part] = (residuals[part, None] @ weighted)[:, 0]
        model = Model(blocks, gradient)
        if frames > 2:
            acceleration, weight = self._weighted_accelerations(pose)
            model.add_differences(np.r_[0:3, 6:variables], self._stencil(), acceleration, weight)
        return model

    def gradient(self, pose: Pose, links: Links) -> np.ndarray:
        """(T, V) of the softened loss: the majorizer's, without its matrix."""
        frames, variables = len(pose.joints), 6 + len(self.limits)
        residuals, weights, points = self._weighted(links)
        pull, gradient = residuals * weights, np.empty((frames, variables))
        jacobian = Jacobian(self.tree, self.point_links, self.turn_links, min(_CHUNK, frames))
        for begin in range(0, frames, _CHUNK):
            part = slice(begin, begin + _CHUNK)
            gradient[part] = (pull[part, None] @ jacobian.fill(Links(links.pos[part], links.quat[part]), points[part]))[
                :, 0
            ]
        if frames > 2:
            acceleration, weight = self._weighted_accelerations(pose)
            for i, factor in enumerate(self._stencil()):
                gradient[i : frames - 2 + i, np.r_[0:3, 6:variables]] += factor * weight * acceleration
        return gradient

    def _weighted(self, links: Links) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (T, 3 P + 3 Q), their weights in the majorizer, and the points (T, P, 3)."""
        errors, turns, points = self._residuals(links)
        frames = len(errors)
        point_weights = np.broadcast_to(2.0 * self.point_weights[:, None], errors.shape).copy()
        if self.soles:
            point_weights[:, -self.soles :] *= errors[:, -self.soles :] < 0
        # The gradient of half a squared angle is the rotation vector itself, and the identity bounds its second
        # derivative: the Jacobian of the
        # logarithm is not needed.
        turn_weights = np.repeat(self.turn_weights / _size((turns**2).sum(-1), self.softness), 3, axis=-1)
        residuals = np.concatenate([errors.reshape(frames, -1), turns.reshape(frames, -1)], 1)
        return residuals, np.concatenate([point_weights.reshape(frames, -1), turn_weights], 1), points

    def _weighted_accelerations(self, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (T - 2, 3 + N) and their weights in the majorizer."""
        acceleration = self._accelerations(pose)
        return acceleration, self.acceleration_weights / _size(acceleration**2, self.acceleration_softness)

    def _stencil(self) -> np.ndarray:
        return np.array([1.0, -2.0, 1.0]) * self.fps**2

    def _residuals(self, links: Links) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Errors (T, P, 3) of the points [m], world rotation vectors (T, Q, 3) from target to link [rad], and the
        points (T, P, 3) themselves.
        """
        points = links.pos[:, self.point_links] + rot.rotate(links.quat[:, self.point_links], self.point_offsets)
        errors = points - self.point_targets
        if self.soles:
            errors[:, -self.soles :, :2] = 0.0
            errors[:, -self.soles :, 2] = np.minimum(errors[:, -self.soles :, 2], 0.0)
        return (
            errors,
            rot.to_rotvec(rot.multiply(links.quat[:, self.turn_links], rot.conjugate(self.turn_targets))),
            points,
        )

    def _accelerations(self, pose: Pose) -> np.ndarray:
        """(T - 2, 3 + N) second differences of root position [m/s^2] and joint angles [rad/s^2]."""
        return np.diff(np.concatenate([pose.root_pos, pose.joints], 1), 2, axis=0) * self.fps**2


def optimize(clip: Clip, config: OptimizationConfig | None = None) -> RobotMotion:
    """The robot motion of least loss, joint limits kept.

    Raises:
        UnknownName: There is no mapping from this skeleton to this robot.
        BadMotion: The skeleton or the robot lacks something that the mapping names.
    """
    return optimize_towards(clip, *clip.motion.forward_kinematics(), config or OptimizationConfig())


def optimize_towards(clip: Clip, pos_w: np.ndarray, quat_w: np.ndarray, config: OptimizationConfig) -> RobotMotion:
    """The same with joint positions (T, J, 3) [m] and orientations (T, J, 4) to follow that are not the human's own."""
    bound = clip.bind(config.preset)
    tree, limits = tree_of(clip.robot), storable(clip.robot.joint_range)
    problem = make_problem(bound, tree, limits, pos_w, quat_w, clip.motion.fps, config, clip.by_hand)
    pose, losses = solve(
        problem, copy_rotations(bound, tree, limits, pos_w, quat_w), config.iterations, config.tolerance
    )
    return clip.grounded(tree, pose, bound, {"loss": losses[-1], "iterations": float(len(losses) - 1)})


def make_problem(
    bound: Bound,
    tree: Tree,
    limits: np.ndarray,
    pos_w: np.ndarray,
    quat_w: np.ndarray,
    fps: float,
    config: OptimizationConfig,
    by_hand: bool = False,
) -> Problem:
    """Targets and weights from the human's joint poses (T, J, 3) and (T, J, 4); `by_hand`: L_hand counts."""
    frames, pairs = len(pos_w), len(bound.links)
    links, offsets = [bound.links], [np.zeros((pairs, 3))]
    targets = [followed_points(bound, pos_w, quat_w)]
    weights = [config.position * bound.weights / (frames * pairs)]
    if by_hand and config.hand > 0:
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
    turns, first, counts = np.unique(
        np.stack([bound.turn_joints, bound.turn_links], -1), axis=0, return_index=True, return_counts=True
    )
    return Problem(
        tree,
        limits,
        fps,
        np.concatenate(links),
        np.concatenate(offsets),
        np.concatenate(targets, 1),
        np.concatenate(weights),
        soles,
        turns[:, 1],
        rot.multiply(quat_w[:, turns[:, 0]], bound.turn_offsets[first]),
        config.orientation * counts / (frames * pairs),
        np.repeat([config.root_acceleration / 3, config.acceleration / len(limits)], [3, len(limits)])
        / max(1, frames - 2),
        config.softness[0],
        np.repeat(config.softness[2:0:-1], [3, len(limits)]),
    )


def _size(squared: np.ndarray, softness: float | np.ndarray) -> np.ndarray:
    """The softened absolute value."""
    return np.sqrt(squared + softness**2)


CONFIGS: dict[Preset, OptimizationConfig] = {"paper": PAPER, "improved": OptimizationConfig()}
METHOD = Method("optimization", "Optimization", lambda clip, preset: optimize(clip, CONFIGS[preset]))
