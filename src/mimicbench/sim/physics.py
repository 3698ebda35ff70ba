"""The one interface to batched physics, and what it reports.

`native.py` implements it on CPU threads, `warp.py` on NVIDIA GPUs; `backends.py` chooses by device.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np
import torch

from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.broken import BrokenLog
from mimicbench.sim.contact import add_contact_sensors
from mimicbench.sim.rows import Rows
from mimicbench.sim.scene import describe_scene


@dataclass(frozen=True)
class PhysicsConfig:
    """What a scene is compiled with beside robot and object."""

    gains: str = "improved"
    """Which of the robot's gains drive it."""
    control: str = "position"
    """What targets are: `position`, `velocity` or `torque`."""
    visuals: bool = False
    """Give the models that `model(env)` returns what is only there for pictures."""
    meshes: bool | None = None
    """Make room for imported objects' convex pieces, on `cpu`; None: if any of the first objects has some."""
    friction: float = 1.0
    """Times the sliding friction that everything has."""
    mass: float = 1.0
    """Times the mass and inertia that the robot's links have."""
    measure_contact: bool = False
    """Measure the forces of contact on every link; without, steps are quicker."""
    broken_dir: Path | None = None
    """Where scenes whose physics breaks are written; None: a new temporary folder."""


def compile_scene(robot: Robot, obj: SceneObject, config: PhysicsConfig, meshes: bool | None = None) -> mujoco.MjModel:
    """The scene of a robot and an object; `meshes` as in `describe_scene`."""
    scene = describe_scene(
        robot, obj, config.gains, config.control, config.visuals, meshes, config.friction, config.mass
    )
    if config.measure_contact:
        add_contact_sensors(scene, robot)
    return scene.compile()


def catalogued(catalog: list[SceneObject], places: dict[str, int], objects: Sequence[SceneObject]) -> list[int]:
    """Places of objects in a catalog, by their ids, at whose end those are put that it lacks."""
    for obj in objects:
        if obj.id not in places:
            places[obj.id] = len(catalog)
            catalog.append(obj)
    return [places[obj.id] for obj in objects]


@dataclass(frozen=True)
class RobotState:
    """Joint-space state of N robots, on the physics' device. What physics reports has 32 bits."""

    root_pos_w: torch.Tensor
    """(N, 3) [m]."""
    root_quat_w: torch.Tensor
    """(N, 4)."""
    root_lin_vel_w: torch.Tensor
    """(N, 3) [m/s]."""
    root_ang_vel_b: torch.Tensor
    """(N, 3) [rad/s], in the root's own frame."""
    joint_pos: torch.Tensor
    """(N, J) [rad]."""
    joint_vel: torch.Tensor
    """(N, J) [rad/s]."""

    @staticmethod
    def of(
        root_pos_w: np.ndarray,
        root_quat_w: np.ndarray,
        joint_pos: np.ndarray,
        root_lin_vel_w: np.ndarray | None = None,
        root_ang_vel_b: np.ndarray | None = None,
        joint_vel: np.ndarray | None = None,
        device: str = "cpu",
    ) -> "RobotState":
        """From arrays on the host; velocities that are not given are zero."""
        pos, quat, joints = (np.asarray(array, float) for array in (root_pos_w, root_quat_w, joint_pos))
        still = np.zeros_like(pos)
        lin, ang = (still if v is None else np.asarray(v, float) for v in (root_lin_vel_w, root_ang_vel_b))
        turning = np.zeros_like(joints) if joint_vel is None else np.asarray(joint_vel, float)
        return RobotState(*(torch.from_numpy(array).to(device) for array in (pos, quat, lin, ang, joints, turning)))


@dataclass(frozen=True)
class ObjectState:
    """Where the objects of N scenes are and how they move; at the origin and at rest where they are fixed."""

    pos_w: torch.Tensor
    """(N, 3) of their origins [m]."""
    quat_w: torch.Tensor
    """(N, 4)."""
    lin_vel_w: torch.Tensor
    """(N, 3) of their origins [m/s]."""
    ang_vel_b: torch.Tensor
    """(N, 3) [rad/s], in their own frames."""

    @staticmethod
    def at_origin(count: int, device: str | torch.device = "cpu") -> "ObjectState":
        """Objects where every episode finds them: at the origin, facing +x, at rest."""
        pos, quat = torch.zeros(count, 3, device=device), torch.zeros(count, 4, device=device)
        quat[:, 0] = 1.0
        return ObjectState(pos, quat, torch.zeros_like(pos), torch.zeros_like(pos))


@dataclass(frozen=True)
class LinkPoses:
    """Poses of all L links of N robots."""

    pos_w: torch.Tensor
    """(N, L, 3) [m]."""
    quat_w: torch.Tensor
    """(N, L, 4)."""


@dataclass(frozen=True)
class LinkState(LinkPoses):
    """Poses and velocities of all L links of N robots."""

    lin_vel_w: torch.Tensor
    """(N, L, 3) velocity of the link's origin [m/s]."""
    ang_vel_w: torch.Tensor
    """(N, L, 3) [rad/s]."""


class Physics(Protocol):
    """N scenes of one robot, each with its own object, stepped together at the control rate."""

    robot: Robot
    num_envs: int
    device: str
    """Where its tensors live, as torch calls it."""
    workers: int
    """Threads of the host that it may use."""
    asynchronous: bool
    """Whether its tensors are worked out while the host goes on: reading one would stop both."""
    object_index: torch.Tensor
    """(N,) int64, which of the catalog each scene has."""

    @property
    def catalog(self) -> Sequence[SceneObject]:
        """The objects that scenes can have."""
        ...

    @property
    def broken(self) -> BrokenLog:
        """What was told of scenes whose physics broke."""
        ...

    @property
    def objects(self) -> Sequence[SceneObject]:
        """The object in each scene; reads `object_index`."""
        ...

    def model(self, env: int) -> mujoco.MjModel:
        """The compiled scene `env`, for rendering or replaying it."""
        ...

    def qpos(self) -> np.ndarray:
        """(N, nq) MuJoCo's positions now, to be read: root, joints, then the object's if it moves."""
        ...

    def qvel(self) -> np.ndarray:
        """(N, nv) MuJoCo's velocities now, to be read."""
        ...

    def add_objects(self, objects: Sequence[SceneObject]) -> list[int]:
        """Places of objects in the catalog, at whose end those are put that it lacks.

        Raises BadObject or MimicbenchError for what cannot share a batch with the others: movable among fixed ones,
        convex pieces where there is no room for them.
        """
        ...

    def set_objects(self, rows: Rows, index: torch.Tensor) -> None:
        """Exchange the objects of scenes `rows` for those at `index` (n,) of the catalog."""
        ...

    def reset(self, rows: Rows, robot: RobotState, obj: ObjectState | None = None) -> None:
        """Put scenes `rows` into a state of n robots and objects, of any precision; None: objects at the origin."""
        ...

    def step(self, target: torch.Tensor, measure_effort: bool = False, running: torch.Tensor | None = None) -> None:
        """Advance scenes `running` (N,) bool (None: all) one control step with targets (N, J).

        Targets are joint angles, velocities or torques by the control mode. With `measure_effort`, `effort` holds e =
        sum_j (tau_j v_j)^2 of this control step, tau and v being means over its substeps (appendix D.2).
        """
        ...

    def advance(self, target: torch.Tensor) -> None:
        """One control step of all scenes with targets (N, J), and nothing else: no reports, no effort.

        Returns when it is over. This is the least that a step can cost, beside which everything else is measured.
        """
        ...

    def state(self) -> RobotState:
        """Joint-space state now."""
        ...

    def object_state(self) -> ObjectState:
        """Where the objects are now."""
        ...

    def links(self) -> LinkState:
        """Poses and velocities of all links now."""
        ...

    def link_poses(self) -> LinkPoses:
        """Poses of all links now, of the same bits as `links`, where those cost more than they do."""
        ...

    def object_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3) [m] and orientations (N, 4) of the objects now, in double precision and on the host."""
        ...

    def ray(
        self, starts: np.ndarray, rays: np.ndarray, groups: Sequence[int], ids: np.ndarray | None = None
    ) -> np.ndarray:
        """How many lengths of its ray (n, R, 3) it is from each start (n, R, 3) to a geom of `groups`.

        (n, R), -1 for a miss. In scenes `ids`, ascending (None: all). One start (n, 1, 3) may serve all rays of a
        scene.
        """
        ...

    def push(self, lin_vel_w: torch.Tensor) -> None:
        """Add (N, 3) [m/s] to the roots' velocities."""
        ...

    def assist(self, force_w: torch.Tensor, torque_w: torch.Tensor) -> None:
        """Forces (N, 3) [N] and torques (N, 3) [N m] in the world's frame on the roots, until they are set anew.

        They act at the root link's center of mass.
        """
        ...

    def contact_force(self) -> torch.Tensor:
        """(N, L, 3) sum of all forces of contact on each link in the last physics step [N], in the world's frame.

        Zeros in scenes that were just reset. Raises MimicbenchError unless it is measured (PhysicsConfig).
        """
        ...

    @property
    def effort(self) -> torch.Tensor:
        """(N,) e of the last step that measured it [W^2]."""
        ...

    @property
    def diverged(self) -> torch.Tensor:
        """(N,) whether a scene's physics broke since its reset.

        Something was not finite or far too large, or there were more contacts than there is room for. It is reported
        to `broken`, goes on from some other state, and must be reset. Other scenes are as they would be without it.
        """
        ...

    def report(self) -> None:
        """Tell `broken` of scenes that broke; on an asynchronous device only this does, elsewhere every step."""
        ...

    def state_tensors(self) -> dict[str, torch.Tensor]:
        """All that decides how the simulation goes on, to the last bit where the backend is exact."""
        ...

    def load_state_tensors(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """The inverse of `state_tensors`, with the same catalog."""
        ...
