"""The loss of `interaction` retargeting.

Half the sum of (residual / tolerance)^2 over bodies, feet, hands, contacts, clearance, balance and smoothness, as
interaction.py lists them.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.retarget.kinematics import Jacobian, Links, Pose, Tree
from mimicbench.retarget.methods.interaction_config import InteractionConfig
from mimicbench.retarget.methods.support import Support
from mimicbench.retarget.samples import Balls, Masses, Scene, point_rows
from mimicbench.retarget.self_contact import SelfContact
from mimicbench.retarget.solver import Model

_CHUNK = 256  # frames whose Jacobians are held at a time


class Touch(NamedTuple):
    """M residuals of one kind of contact."""

    frame: np.ndarray
    """(M,) ascending."""
    link: np.ndarray | None
    """(M,) whose point it is; None for the center of mass."""
    point_w: np.ndarray
    """(M, 3) [m]."""
    direction_w: np.ndarray
    """(M, 3) along which it should move, over its tolerance [1/m]."""
    residual: np.ndarray
    """(M,)"""
    other: np.ndarray | None = None
    """(M,) the link that it should move away from, or be over, if that is the robot's own."""


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
    support: Support
    scene: Scene
    own: SelfContact
    masses: Masses
    speed_limit: np.ndarray
    """(N,) [rad/s]."""
    leg: np.ndarray
    """(L,) whether a link is part of a leg."""
    last: list = field(default_factory=list)
    """The links that were looked at last, and what was found there."""

    def loss(self, pose: Pose, links: Links) -> float:
        """Half the sum of squared residuals."""
        errors, turns, _ = self._following(links)
        total = ((errors**2).sum(-1) * self.point_weights).sum() + ((turns**2).sum(-1) * self.turn_weights).sum()
        total += sum((touch.residual**2).sum() for touch in self._touching(links))
        acceleration, excess = self._differences(pose)
        return 0.5 * float(
            total + (acceleration**2 * self._smoothness()).sum() + (excess**2).sum() / self.config.velocity**2
        )

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
            model.add_differences(
                np.r_[0:3, 6:variables], np.array([1.0, -2.0, 1.0]) * self.fps**2, acceleration, weight
            )
        if excess.any():
            model.add_differences(
                np.arange(6, variables),
                np.array([-1.0, 1.0]) * self.fps,
                excess,
                (excess != 0) / self.config.velocity**2,
            )
        return model

    def clearance(self, pose: Pose) -> np.ndarray:
        """(T, S) distance of all balls from floor and object [m]."""
        return self.scene.clearance(self.balls, self.balls.place(self.tree.place(pose)))[0]

    def misplaced(self, distance: np.ndarray) -> tuple[bool, bool]:
        """Whether who ends sitting hovers over the seat, in the median, and whether who ends lying is ever with its
        head in a board.
        """
        seated, lying = self.support.seated, self.support.lying
        sits = seated[-1] and np.median(distance[seated][:, self.balls.link == 0].min(-1)) > self.config.hover
        lies = lying[-1] and np.mean(distance[lying].min(-1) < -self.config.hover) > 0.02
        return bool(sits), bool(lies)

    def off(self, pose: Pose, distance: np.ndarray) -> float:
        """How far who ends sitting leans otherwise than the person, or hovers before what it should lean against:
        beyond 1 is too far.
        """
        if not self.support.seated[-1]:
            return 0.0
        _, turns, _ = self._following(self.tree.place(pose))
        lean = np.linalg.norm(turns[self.support.seated][:, self.turn_links == 0, :2], axis=-1)
        gaps = [np.median(distance[when][:, which].min(-1)) for when, which in self.support.bearing if when[-1]]
        return float(max(np.median(lean) / self.config.off, max(gaps, default=0.0) / self.config.hover))

    def stuck(self, distance: np.ndarray) -> bool:
        """Whether something is deep in floor or object for long: an elbow that went through a thin board finds no
        way back.
        """
        return bool(np.mean(distance.min(-1) < -self.config.hover) > 0.02)

    def filled(self) -> "Problem":
        """The same with all boxes of the object reaching down to the floor, and for all of the body but the legs."""
        obj = self.scene.obj
        upright = np.abs(rot.to_matrix(obj.box_quat)[:, 2, 2]) > 0.99
        top = obj.box_pos[:, 2] + obj.box_half[:, 2]
        pos, half = obj.box_pos.copy(), obj.box_half.copy()
        pos[upright, 2] = half[upright, 2] = 0.5 * top[upright]
        legs = self.leg[self.balls.link]
        return replace(
            self,
            scene=replace(self.scene, obj=replace(obj, box_pos=pos, box_half=half)),
            support=replace(self.support, margins=np.where(legs, -np.inf, self.support.margins)),
            last=[],
        )

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

    def _touching(self, links: Links) -> list[Touch]:
        """What `_touch` finds; the model is asked for where the loss was last."""
        if not self.last or self.last[0] is not links:
            self.last[:] = [links, self._touch(links)]
        return self.last[1]

    def _touch(self, links: Links) -> list[Touch]:
        """Clearance, contacts with the object, contacts with itself, and balance."""
        centers = self.balls.place(links)
        distance, normal = self.scene.clearance(self.balls, centers)
        spare = distance - self.support.margins
        frame, ball = np.nonzero(spare < 0)
        found = [self._of_balls(frame, ball, centers, normal, spare[frame, ball], self.config.clearance)]
        for when, which in self.support.bearing:
            near = np.where(which, distance, np.inf)
            lowest = near.min(-1)
            frame = np.flatnonzero(when & (lowest > 0) & np.isfinite(lowest))
            found.append(
                self._of_balls(frame, near.argmin(-1)[frame], centers, normal, lowest[frame], self.config.contact)
            )
        own = self.own.overlaps(links, centers)
        scale = 1 / self.config.self_clearance
        found.append(Touch(own.frame, own.link, own.point_w, own.normal_w * scale, -own.depth * scale, own.other))
        ahead = ((self.masses.center(links) - self.support.ankles) * self.support.heading).sum(-1)
        outside = np.where(self.support.balanced, ahead - np.clip(ahead, *self.config.support), 0.0)
        frame = np.flatnonzero(outside)
        scale = 1 / self.config.balance
        nowhere, heading = np.zeros((len(frame), 3)), self.support.heading[frame]
        found.append(Touch(frame, None, nowhere, heading * scale, outside[frame] * scale))
        return [*found, self._behind(links, centers, distance)]

    def _behind(self, links: Links, centers: np.ndarray, distance: np.ndarray) -> Touch:
        """Who bears on the root, legs in the air and nothing at the back: the center of mass behind where it bears."""
        frame = np.flatnonzero(self.support.perched)
        own = np.flatnonzero(self.balls.link == 0)
        bears = centers[frame, own[distance[np.ix_(frame, own)].argmin(-1)]]
        facing = rot.rotate(links.quat[frame, 0], np.array([1.0, 0.0, 0.0])) * [1.0, 1.0, 0.0]
        facing /= np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-6)
        ahead = ((self.masses.center(links)[frame] - bears) * facing).sum(-1)
        behind = np.flatnonzero(ahead < self.config.perch)
        scale, frame = 1 / self.config.perch_error, frame[behind]
        return Touch(
            frame,
            None,
            bears[behind],
            facing[behind] * scale,
            (ahead[behind] - self.config.perch) * scale,
            np.zeros(len(frame), int),
        )

    def _of_balls(
        self,
        frame: np.ndarray,
        ball: np.ndarray,
        centers: np.ndarray,
        normal: np.ndarray,
        away: np.ndarray,
        tolerance: float,
    ) -> Touch:
        return Touch(
            frame, self.balls.link[ball], centers[frame, ball], normal[frame, ball] / tolerance, away / tolerance
        )

    def _rows(self, links: Links) -> list[Rows]:
        rows = []
        for touch in self._touching(links):
            if touch.link is None:
                part = Links(links.pos[touch.frame], links.quat[touch.frame])
                jacobian = self.masses.rows(self.tree, part, touch.direction_w)
            else:
                jacobian = point_rows(self.tree, links, touch.frame, touch.link, touch.point_w, touch.direction_w)
            if touch.other is not None:
                jacobian -= point_rows(self.tree, links, touch.frame, touch.other, touch.point_w, touch.direction_w)
            rows.append(Rows(touch.frame, jacobian, touch.residual))
        return rows
