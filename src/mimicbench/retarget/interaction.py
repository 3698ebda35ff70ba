"""Retargeting that keeps the interaction: contacts, feet that stand, a body that neither enters the furniture nor loses its balance.

Plain least squares over the whole clip: half the sum of (residual / tolerance)^2, where a residual is

    bodies      link - followed point, and the rotation from the human's limb to the robot's    (tables of appendix B.1)
    feet        foot - its anchor: still, flat and on the floor from touch-down to lift-off
    hands       wrist - its anchor: the wrist's goal, or the place on the object that the human's palm holds
    contacts    distance of the bearing part (pelvis, back) from the surface, in frames that label it
    clearance   depth of every collision shape in floor and object
    balance     how far the center of mass is in front of or behind both standing feet, while they alone bear
    smoothness  accelerations of root and joints; joint velocities beyond their limit

with joint limits exact. The literature finds that contacts and penetration decide what a controller can track
(OmniRetarget; holosoma); the three methods of the paper know neither.
"""

from dataclasses import dataclass, field

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.retarget.anchors import Anchors, anchors_of
from mimicbench.retarget.clip import Clip, storable
from mimicbench.retarget.copy_rotation import copy_rotations
from mimicbench.retarget.h1_tables import find_mapping
from mimicbench.retarget.kinematics import Jacobian, Links, Pose, Tree, tree_of
from mimicbench.retarget.mapping import followed_points
from mimicbench.retarget.samples import Balls, Masses, Scene, balls_of, point_rows
from mimicbench.retarget.solver import Model, solve

_CHUNK = 256
UP = 4.0
"""Whoever is in the furniture leaves it upwards, unless another way is four times as short: pillows, for one, are not left sideways."""


@dataclass(frozen=True)
class InteractionConfig:
    """How large each residual may be; half as large counts four times as much."""

    position: float = 0.06
    """Of a link from the point that it follows [m]."""
    orientation: float = 0.25
    """Of a limb from the human's [rad]."""
    foot: tuple[float, float] = (0.002, 0.02)
    """Of a foot from its anchor, standing and swinging [m]."""
    foot_rest: float = 0.015
    """The same where it rests on the object [m]."""
    foot_turn: tuple[float, float] = (0.03, 0.3)
    """The same of its orientation [rad]."""
    hand: tuple[float, float] = (0.008, 0.3)
    """Of a wrist from its anchor, in contact and far from any [m]."""
    contact: float = 0.004
    """Of a bearing part from the surface [m]."""
    clearance: float = 0.002
    """Depth in floor or object [m]."""
    margin: float = 0.003
    """Shapes keep this far away from floor and object [m]; what bears, and soles, may touch."""
    balance: float = 0.01
    """Of the center of mass from where it is in balance [m]."""
    support: tuple[float, float] = (-0.03, 0.12)
    """Where that is: behind and in front of the middle of the ankles [m]."""
    before_sitting: float = 0.4
    """[s] Before the pelvis bears, balance no longer counts: people let themselves fall the last bit."""
    acceleration: float = 12.0
    """Of a joint [rad/s^2]."""
    root_acceleration: float = 3.0
    """[m/s^2]"""
    velocity_share: float = 0.8
    """Share of a joint's velocity limit that it may use."""
    velocity: float = 0.2
    """Beyond that share [rad/s]."""
    slides: tuple[float, ...] = (0.08, 0.16, 0.24)
    """How far towards its feet a body is put, one after the other until it rests [m]. On a seat higher than its knees a robot with long thighs
    lies on the front edge with them and hovers with its buttocks; on a bed of people's length a taller one has its head in the board."""
    hover: float = 0.02
    """[m] of buttocks above the seat that is still rest, and of a head in a board that may be mended without that."""
    iterations: int = 25
    """Gauss-Newton steps at most."""
    tolerance: float = 1e-3
    """Stop when a step lowers the loss by less than this part of it."""


def interact(clip: Clip, config: InteractionConfig | None = None) -> RobotMotion:
    """The robot motion that does with the object what the human does. Raises UnknownName or BadMotion."""
    config = config or InteractionConfig()
    problem, start = make_problem(clip, config)
    pose, losses = solve(problem, start, config.iterations, config.tolerance)
    for slide in config.slides:
        sits, lies = problem.misplaced(problem.tree.place(pose))
        if not (sits or lies):
            break
        problem, moved = make_problem(clip, config, slide * sits, slide * lies)
        pose = pose._replace(root_pos=pose.root_pos + moved.root_pos - start.root_pos)  # a head must get past the board
        pose, losses = solve(problem, pose, config.iterations, config.tolerance)
        start = moved
    return clip.finished(problem.tree, pose, clip.bind("improved"), {"loss": losses[-1], "iterations": float(len(losses) - 1)})


Touches = list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
"""Frames (M,) ascending, links (M,), points (M, 3), directions (M, 3) and residuals (M,) over tolerances, of several kinds of contact."""


@dataclass(frozen=True)
class Rows:
    """Residuals that only some frames have: M of them."""

    frame: np.ndarray
    """(M,) ascending."""
    jacobian: np.ndarray
    """(M, V)"""
    residual: np.ndarray
    """(M,) over its tolerance."""


@dataclass(frozen=True)
class Problem:
    """The loss of one clip."""

    tree: Tree
    limits: np.ndarray
    """(N, 2) [rad]."""
    config: InteractionConfig
    fps: float
    point_links: np.ndarray
    """(P,) links of the points that follow something in every frame: pairs, wrists."""
    point_offsets: np.ndarray
    """(P, 3) in the link frame [m]."""
    point_targets: np.ndarray
    """(T, P, 3) [m]."""
    point_weights: np.ndarray
    """(T, P) 1 / tolerance^2 [1/m^2]."""
    turn_links: np.ndarray
    """(Q,)"""
    turn_targets: np.ndarray
    """(T, Q, 4)."""
    turn_weights: np.ndarray
    """(T, Q) [1/rad^2]."""
    balls: Balls
    margins: np.ndarray
    """(T, S) least clearance of each ball [m]."""
    bearing: tuple[tuple[np.ndarray, np.ndarray], ...]
    """Of each part that bears: (T,) when, and (S,) which balls it is made of."""
    seated: np.ndarray
    """(T,) whether the root bears and both feet stand on the floor."""
    lying: np.ndarray
    """(T,) whether the root bears and no foot stands on the floor."""
    scene: Scene
    masses: Masses
    balanced: np.ndarray
    """(T,) whether the center of mass must be over the feet."""
    heading: np.ndarray
    """(T, 3) mean direction of the feet."""
    ankles: np.ndarray
    """(T, 3) middle of both ankles' anchors [m]."""
    speed_limit: np.ndarray
    """(N,) [rad/s]."""
    last: list = field(default_factory=list)
    """The links that were looked at last, and what was found there."""

    def loss(self, pose: Pose, links: Links) -> float:
        """Half the sum of squared residuals."""
        errors, turns, _ = self._following(links)
        total = ((errors**2).sum(-1) * self.point_weights).sum() + ((turns**2).sum(-1) * self.turn_weights).sum()
        total += sum((residual**2).sum() for *_, residual in self._touching(links))
        acceleration, excess = self._differences(pose)
        return 0.5 * float(total + (acceleration**2 * self._smoothness()).sum() + (excess**2).sum() / self.config.velocity**2)

    def model(self, pose: Pose, links: Links) -> Model:
        """Its Gauss-Newton model."""
        frames, variables = len(pose.joints), 6 + len(self.limits)
        errors, turns, points = self._following(links)
        weights = np.concatenate([np.repeat(self.point_weights, 3, 1), np.repeat(self.turn_weights, 3, 1)], 1)
        residuals = np.concatenate([errors.reshape(frames, -1), turns.reshape(frames, -1)], 1)
        blocks, gradient = np.empty((frames, variables, variables)), np.empty((frames, variables))
        jacobian = Jacobian(self.tree, self.point_links, self.turn_links, min(_CHUNK, frames))
        for begin in range(0, frames, _CHUNK):
            part = slice(begin, begin + _CHUNK)
            rows = jacobian.fill(Links(links.pos[part], links.quat[part]), points[part])
            weighted = rows * weights[part, :, None]
            blocks[part] = np.swapaxes(weighted, 1, 2) @ rows
            gradient[part] = (residuals[part, None] @ weighted)[:, 0]
        for rows in self._rows(links):
            if not len(rows.frame):
                continue
            first = np.flatnonzero(np.concatenate([[True], np.diff(rows.frame) > 0]))
            counts = np.diff(np.append(first, len(rows.frame)))
            # the rows of each frame side by side, so that one batched product adds them up
            place = np.repeat(np.arange(len(first)), counts), np.arange(len(rows.frame)) - np.repeat(first, counts)
            beside, residual = np.zeros((len(first), counts.max(), variables)), np.zeros((len(first), 1, counts.max()))
            beside[place], residual[place[0], 0, place[1]] = rows.jacobian, rows.residual
            blocks[rows.frame[first]] += np.swapaxes(beside, 1, 2) @ beside
            gradient[rows.frame[first]] += (residual @ beside)[:, 0]
        model = Model(blocks, gradient)
        acceleration, excess = self._differences(pose)
        if frames > 2:
            weight = np.broadcast_to(self._smoothness(), acceleration.shape)
            model.add_differences(np.r_[0:3, 6:variables], np.array([1.0, -2.0, 1.0]) * self.fps**2, acceleration, weight)
        if excess.any():
            model.add_differences(np.arange(6, variables), np.array([-1.0, 1.0]) * self.fps, excess, (excess != 0) / self.config.velocity**2)
        return model

    def misplaced(self, links: Links) -> tuple[bool, bool]:
        """Whether who ends sitting hovers over the seat, in the median, and whether who ends lying is ever with its head in a board."""
        distance, _ = self.scene.clearance(self.balls, self.balls.place(links))
        sits = self.seated[-1] and np.median(distance[self.seated][:, self.balls.link == 0].min(-1)) > self.config.hover
        lies = self.lying[-1] and np.mean(distance[self.lying].min(-1) < -self.config.hover) > 0.02
        return bool(sits), bool(lies)

    def _following(self, links: Links) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Errors (T, P, 3) [m], rotation vectors (T, Q, 3) from target to link [rad], and the points (T, P, 3)."""
        points = links.pos[:, self.point_links] + rot.rotate(links.quat[:, self.point_links], self.point_offsets)
        turns = rot.to_rotvec(rot.multiply(links.quat[:, self.turn_links], rot.conjugate(self.turn_targets)))
        return points - self.point_targets, turns, points

    def _differences(self, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (T - 2, 3 + N), and joint velocities (T - 1, N) as far as they are beyond what is allowed."""
        acceleration = np.diff(np.concatenate([pose.root_pos, pose.joints], 1), 2, axis=0) * self.fps**2
        velocity = np.diff(pose.joints, axis=0) * self.fps
        return acceleration, velocity - np.clip(velocity, -self.speed_limit, self.speed_limit)

    def _smoothness(self) -> np.ndarray:
        return np.repeat([self.config.root_acceleration**-2, self.config.acceleration**-2], [3, len(self.limits)])

    def _touching(self, links: Links) -> Touches:
        """What `_touch` finds; the model is asked for where the loss was last."""
        if not self.last or self.last[0] is not links:
            self.last[:] = [links, self._touch(links)]
        return self.last[1]

    def _touch(self, links: Links) -> Touches:
        """Clearance, contacts: frames, links, points (M, 3), directions (M, 3), residuals over tolerances; and balance, on link -1."""
        centers = self.balls.place(links)
        distance, normal = self.scene.clearance(self.balls, centers)
        found = []
        frame, ball = np.nonzero(distance < self.margins)
        inside = (distance - self.margins)[frame, ball] / self.config.clearance
        found.append((frame, self.balls.link[ball], centers[frame, ball], normal[frame, ball] / self.config.clearance, inside))
        for when, which in self.bearing:
            near = np.where(which, distance, np.inf)
            ball = near.argmin(-1)
            frame = np.flatnonzero(when & (near.min(-1) > 0) & np.isfinite(near.min(-1)))
            ball = ball[frame]
            away = distance[frame, ball] / self.config.contact
            found.append((frame, self.balls.link[ball], centers[frame, ball], normal[frame, ball] / self.config.contact, away))
        frame = np.flatnonzero(self.balanced)
        if len(frame):
            ahead = ((self.masses.center(links) - self.ankles)[frame] * self.heading[frame]).sum(-1)
            outside = ahead - np.clip(ahead, *self.config.support)
            keep = outside != 0
            frame = frame[keep]
            found.append(
                (frame, np.full(len(frame), -1), np.zeros((len(frame), 3)), self.heading[frame] / self.config.balance, outside[keep] / self.config.balance)
            )
        return found

    def _rows(self, links: Links) -> list[Rows]:
        rows = []
        for frame, link, points, direction, residual in self._touching(links):
            if len(frame) and link[0] < 0:
                part = Links(links.pos[frame], links.quat[frame])
                rows.append(Rows(frame, self.masses.rows(self.tree, part, direction), residual))
            else:
                rows.append(Rows(frame, point_rows(self.tree, links, frame, link, points, direction), residual))
        return rows


def make_problem(clip: Clip, config: InteractionConfig, sitting: float = 0.0, lying: float = 0.0) -> tuple[Problem, Pose]:
    """Targets and tolerances of a clip, and a pose to start from; whoever sits or lies is to do so that much [m] nearer to its feet."""
    motion, robot = clip.motion, clip.robot
    mapping = find_mapping(motion.skeleton.name, robot.name)
    bound = clip.bind("improved")
    tree, limits = tree_of(robot), storable(robot.joint_range)
    pos_w, quat_w = motion.forward_kinematics()
    anchors = anchors_of(clip, mapping, bound, pos_w, quat_w)
    frames, feet = motion.frames, [link for _, link in bound.feet]

    targets = followed_points(bound, pos_w, quat_w)
    tolerance = np.full(targets.shape[:2], config.position)
    is_foot = np.isin(bound.links, feet)
    targets[:, ~is_foot, 2] -= anchors.lowering[:, None]
    wrist_links, wrist_points = np.array([link for _, link, _ in bound.wrists]), np.array([point for *_, point in bound.wrists])
    for foot, link in enumerate(feet):
        column = bound.links.tolist().index(link)
        targets[:, column] = anchors.foot_pos_w[:, foot]
        rests = np.where(anchors.standing[:, foot], config.foot_rest, config.foot[1])
        tolerance[:, column] = np.where(anchors.on_floor[:, foot], config.foot[0], rests)
    near, far = config.hand
    hand = far * (near / far) ** anchors.nearness  # from far to near by equal ratios

    turns, first = np.unique(np.stack([bound.turn_joints, bound.turn_links], -1), axis=0, return_index=True)
    turn_targets = rot.multiply(quat_w[:, turns[:, 0]], bound.turn_offsets[first])
    turn_tolerance = np.full(turn_targets.shape[:2], config.orientation)
    for foot, link in enumerate(feet):
        column = turns[:, 1].tolist().index(link)
        turn_targets[:, column] = anchors.foot_quat_w[:, foot]
        turn_tolerance[:, column] = np.where(anchors.on_floor[:, foot], *config.foot_turn)

    balls = balls_of(robot)
    margins = np.where(np.isin(balls.link, feet), 0.0, config.margin) * np.ones((frames, 1))
    bearing = []
    for column, name in enumerate(motion.contact_names):
        links = [robot.link_names.index(link) for link in mapping.bearers.get(name, ())]
        when, which = motion.contacts[:, column].astype(bool), np.isin(balls.link, links)
        margins[np.ix_(when, which)] = 0.0
        if not set(links) & {*feet, *wrist_links}:  # feet and hands have their anchors
            bearing.append((when, which))
    bears = np.any([when & which[balls.link == 0].any() for when, which in bearing] or [np.zeros(frames, bool)], 0)
    seated, lies = bears & anchors.on_floor.all(-1), bears & ~anchors.on_floor.any(-1)
    balanced, heading, ankles = _balance(motion.fps, anchors, bearing, config)
    to_feet = (ankles - targets[:, bound.links.tolist().index(0)]) * [1.0, 1.0, 0.0]
    to_feet /= np.maximum(np.linalg.norm(to_feet, axis=-1, keepdims=True), 0.1)
    forward = (sitting * _eased(seated, motion.fps) + lying * _eased(lies, motion.fps))[:, None] * to_feet
    targets[:, ~is_foot] += forward[:, None]
    start = copy_rotations(bound, tree, limits, pos_w, quat_w)
    start = start._replace(root_pos=start.root_pos + forward - anchors.lowering[:, None] * np.array([0.0, 0.0, 1.0]))
    return Problem(
        tree, limits, config, motion.fps, np.concatenate([bound.links, wrist_links]), np.concatenate([np.zeros((len(bound.links), 3)), wrist_points]),
        np.concatenate([targets, anchors.hand_pos_w], 1), np.concatenate([tolerance, hand], 1) ** -2, turns[:, 1], turn_targets, turn_tolerance**-2,
        balls, margins, tuple(bearing), seated, lies, Scene.of(motion, clip.obj, UP), Masses.of(robot), balanced, heading, ankles,
        config.velocity_share * robot.velocity_limit,
    ), start  # fmt: skip


def _eased(when: np.ndarray, fps: float) -> np.ndarray:
    """(T,) 1 in the frames `when` (T,), rising to it in the second before them and falling in the second after."""
    half = max(1, round(0.5 * fps))
    most = np.lib.stride_tricks.sliding_window_view(np.pad(when.astype(float), 2 * half, mode="edge"), 2 * half + 1).max(-1)
    kernel = np.hanning(2 * half + 3)[1:-1]
    return np.lib.stride_tricks.sliding_window_view(most, 2 * half + 1) @ (kernel / kernel.sum())


def _balance(
    fps: float, anchors: Anchors, bearing: list[tuple[np.ndarray, np.ndarray]], config: InteractionConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T,) when the feet alone bear, (T, 3) where they point on average, (T, 3) the middle of the ankles [m]."""
    alone = np.asarray(anchors.on_floor.all(-1))
    soon = round(config.before_sitting * fps)
    for when, _ in bearing:
        for shift in range(soon + 1):
            alone = alone & ~np.concatenate([when[shift:], np.repeat(when[-1:], min(shift, len(when)))])
    heading = rot.rotate(anchors.foot_quat_w, np.array([1.0, 0.0, 0.0])).mean(1) * [1.0, 1.0, 0.0]
    heading /= np.maximum(np.linalg.norm(heading, axis=-1, keepdims=True), 1e-6)
    return alone, heading, anchors.foot_pos_w.mean(1)
