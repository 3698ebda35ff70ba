"""What the toolkit knows of a robot. Everything robot-specific is data in this form; no other module names a link."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import UnknownName
from mimicbench.robots.mapping import Mapping as HumanMapping

Vector = tuple[float, ...]


@dataclass(frozen=True)
class Link:
    """A rigid body; its frame sits in its parent's."""

    name: str
    parent: int
    """Index of the parent link, -1 for the free root."""
    pos: Vector
    """Position in the parent's frame [m]."""
    quat: Vector
    """Orientation in the parent's frame, wxyz."""
    mass: float
    """[kg]."""
    com: Vector
    """Center of mass in the link frame [m]."""
    inertia: Vector
    """xx, yy, zz, xy, xz, yz about the center of mass, link axes [kg m^2]."""


@dataclass(frozen=True)
class Joint:
    """A hinge at the origin of the link that it drives."""

    name: str
    link: int
    axis: Vector
    """Unit axis in the link frame."""
    range: tuple[float, float]
    """Limits [rad]."""
    torque_limit: float
    """[N m]."""
    velocity_limit: float
    """[rad/s]."""
    armature: float | None = None
    """Rotor inertia seen at it [kg m^2], if not what the robot says of all its joints."""


@dataclass(frozen=True)
class Gains:
    """A proportional-derivative controller and the scale of a residual action, per joint."""

    kp: Vector
    """[N m/rad]."""
    kd: Vector
    """[N m s/rad]."""
    action_scale: Vector
    """Radians that an action of 1 moves the target by."""


@dataclass(frozen=True)
class Shape:
    """A geometric primitive on a link."""

    link: int
    type: str
    """`capsule`, `cylinder`, `sphere`, `box` or `ellipsoid`."""
    size: Vector
    """Radius for round shapes; half sizes for boxes and ellipsoids [m]."""
    start: Vector
    """One end of a capsule or cylinder, the center of the others, in the link frame [m]."""
    end: Vector | None = None
    """Other end of a capsule or cylinder."""
    group: str = ""
    """Self-collision group of a collision shape, or the color of a visual one."""


@dataclass(frozen=True)
class Robot:
    """A humanoid: a free root link and hinges."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    gains: Mapping[str, Gains]
    """By preset name."""
    armature: float
    """Rotor inertia seen at every joint that does not say its own [kg m^2]."""
    damping: float
    """Passive damping of every joint [N m s/rad]."""
    keypoints: Mapping[str, tuple[int, Vector]]
    """Named points (link index, position in the link frame [m]): ankles, wrists, soles."""
    rest_pose: Vector
    """Joint angles of a relaxed stand [rad]."""
    arms_down: Mapping[str, float]
    """Joint angles, by name, that bring the zero pose to standing with arms straight down [rad]."""
    collision: tuple[Shape, ...]
    visual: tuple[Shape, ...]
    collides: tuple[tuple[str, str], ...]
    """Pairs of self-collision groups that touch each other; all others pass through."""
    legs: tuple[tuple[str, str, str], ...]
    """Links of each leg, left first: whose frame's origin is the middle of the hip, whose is that of the knee, and the
    foot. There may be others between them."""
    mappings: tuple[HumanMapping, ...] = ()
    """From human skeletons: whose motions can be retargeted to it."""

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """(L,) names."""
        return tuple(link.name for link in self.links)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """(N,) names, the order of every joint vector."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def link_parents(self) -> tuple[int, ...]:
        """(L,) index of each link's parent."""
        return tuple(link.parent for link in self.links)

    @cached_property
    def link_pos(self) -> np.ndarray:
        """(L, 3) [m] in the parent's frame."""
        return np.array([link.pos for link in self.links])

    @cached_property
    def link_quat(self) -> np.ndarray:
        """(L, 4) in the parent's frame."""
        return rot.normalize(np.array([link.quat for link in self.links]))

    @cached_property
    def joint_link(self) -> np.ndarray:
        """(N,) index of the link that each joint drives."""
        return np.array([joint.link for joint in self.joints])

    @cached_property
    def link_levels(self) -> tuple[list[int], ...]:
        """Links in order of their depth below the root, those of one depth together; without the root."""
        depths: list[int] = []
        for parent in self.link_parents:
            depths.append(0 if parent < 0 else depths[parent] + 1)
        return tuple([i for i, at in enumerate(depths) if at == depth] for depth in range(1, max(depths) + 1))

    @cached_property
    def link_joint(self) -> np.ndarray:
        """(L,) index of the joint that drives each link; 0 where none does."""
        driving = np.zeros(len(self.links), int)
        driving[self.joint_link] = range(len(self.joints))
        return driving

    @cached_property
    def link_axis(self) -> np.ndarray:
        """(L, 3) the joint's axis in the link frame; zero where none drives it."""
        axes = np.zeros((len(self.links), 3))
        axes[self.joint_link] = self.joint_axis
        return axes

    @cached_property
    def joint_axis(self) -> np.ndarray:
        """(N, 3) axes in the link frame."""
        return np.array([joint.axis for joint in self.joints])

    @cached_property
    def joint_range(self) -> np.ndarray:
        """(N, 2) limits [rad]."""
        return np.array([joint.range for joint in self.joints])

    @cached_property
    def velocity_limit(self) -> np.ndarray:
        """(N,) [rad/s]."""
        return np.array([joint.velocity_limit for joint in self.joints])

    def reach(self, upper: int, lower: int) -> float:
        """How far the origin of a link is from that of one above it, with all joints between them at zero [m].

        Raises UnknownName if it is not above it.
        """
        place, link, passed = self.link_pos[lower], self.link_parents[lower], []
        while link != upper:
            if link < 0:
                raise UnknownName(f"link above {self.link_names[lower]}", self.link_names[upper], passed)
            place = self.link_pos[link] + rot.rotate(self.link_quat[link], place)
            passed.append(self.link_names[link])
            link = self.link_parents[link]
        return float(np.linalg.norm(place))

    def keypoint_pos(self, name: str, link_pos: np.ndarray, link_quat: np.ndarray) -> np.ndarray:
        """World position (..., 3) of a keypoint, given all link poses (..., L, 3) and (..., L, 4)."""
        if name not in self.keypoints:
            raise UnknownName("keypoint", name, list(self.keypoints))
        link, offset = self.keypoints[name]
        return link_pos[..., link, :] + rot.rotate(link_quat[..., link, :], np.array(offset))

    def forward_kinematics(
        self, root_pos: np.ndarray, root_quat: np.ndarray, joint_pos: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """World positions (..., L, 3) and orientations (..., L, 4) of all links.

        Args:
            root_pos: (..., 3) root position [m].
            root_quat: (..., 4) root orientation.
            joint_pos: (..., N) joint angles [rad].
        """
        shape = joint_pos.shape[:-1]
        pos, quat = np.empty((*shape, len(self.links), 3)), np.empty((*shape, len(self.links), 4))
        driver = {int(link): j for j, link in enumerate(self.joint_link)}
        for i, parent in enumerate(self.link_parents):
            if parent < 0:
                pos[..., i, :], quat[..., i, :] = root_pos, root_quat
                continue
            pos[..., i, :] = pos[..., parent, :] + rot.rotate(quat[..., parent, :], self.link_pos[i])
            turned = rot.multiply(quat[..., parent, :], self.link_quat[i])
            if i in driver:
                j = driver[i]
                turned = rot.multiply(turned, rot.from_rotvec(self.joint_axis[j] * joint_pos[..., j, None]))
            quat[..., i, :] = turned
        return pos, quat
