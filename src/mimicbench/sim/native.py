"""Physics on CPU threads: `mujoco.batch`. Results are the same bits at any number of threads."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from mimicbench.core.errors import BadObject, MimicbenchError
from mimicbench.core.parallel import cpu_count
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.broken import BrokenLog, BrokenScene
from mimicbench.sim.contact import SIGN, not_measured
from mimicbench.sim.effort import effort_of
from mimicbench.sim.kinematics import Kinematics
from mimicbench.sim.physics import (
    LinkPoses,
    LinkState,
    ObjectState,
    PhysicsConfig,
    RobotState,
    catalogued,
    compile_scene,
)
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import SUBSTEPS

_WARNINGS = {
    mujoco.mjtWarning.mjWARN_BADQPOS: "positions are not finite, or too large",
    mujoco.mjtWarning.mjWARN_BADQVEL: "velocities are not finite, or too large",
    mujoco.mjtWarning.mjWARN_BADQACC: "accelerations are not finite, or too large",
    mujoco.mjtWarning.mjWARN_BADCTRL: "targets are not finite",
    mujoco.mjtWarning.mjWARN_CONTACTFULL: "there are more contacts than memory for them",
    mujoco.mjtWarning.mjWARN_CNSTRFULL: "there are more constraints than memory for them",
    mujoco.mjtWarning.mjWARN_INERTIA: "the inertia matrix is singular",
}
_KINDS = [int(kind) for kind in _WARNINGS]
_RECORDED = ("actuator_force", "qvel")
"""What effort is worked out of, in every substep."""
KEPT_MODELS = 2048
"""Compiled scenes that a simulation keeps for objects that may come again, of about 55 kB each."""


class NativePhysics:
    """N scenes on `workers` threads (0: all processors). See the Physics protocol for the methods."""

    asynchronous = False
    device = "cpu"

    def __init__(
        self, robot: Robot, objects: Sequence[SceneObject], config: PhysicsConfig | None = None, workers: int = 0
    ) -> None:
        self.robot, self.num_envs, self.config = robot, len(objects), config or PhysicsConfig()
        # room for imported objects' convex pieces, now or later; by default if there are any now
        self._meshes = any(obj.hulls for obj in objects) if self.config.meshes is None else self.config.meshes
        self._compiled: dict[str, mujoco.MjModel] = {}
        self.catalog: list[SceneObject] = []
        self._places: dict[str, int] = {}
        self._movable = objects[0].movable
        self.object_index = torch.tensor(self.add_objects(objects))
        self._models = [self._model(obj) for obj in objects]
        self.batch = Batch(self._models[0], self.num_envs, min(workers or cpu_count(), self.num_envs))
        self.batch.set_models(self._models)
        self.workers = self.batch.nthread
        joints = len(robot.joints)
        self._qpos, self._qvel, self._ctrl = self.batch.bind("qpos"), self.batch.bind("qvel"), self.batch.bind("ctrl")
        self._joint_q, self._joint_v = slice(7, 7 + joints), slice(6, 6 + joints)
        self._object_q, self._object_v = slice(7 + joints, 14 + joints), slice(6 + joints, 12 + joints)
        self._root = self._models[0].body(robot.link_names[0]).id
        self._wrench: np.ndarray | None = None
        self._sensors = self.batch.bind("sensordata") if self.config.measure_contact else None
        self._forces = None if self._sensors is None else self._sensors.copy()
        self.broken = BrokenLog(self.config.broken_dir)
        self._warmstart = self.batch.bind("qacc_warmstart")
        self._before = [array.copy() for array in (self._qpos, self._qvel, self._warmstart)]
        self._warned, self._reported = np.zeros(self.num_envs, np.int64), np.zeros(self.num_envs, bool)
        self._diverged = self._reported.copy()
        self._effort = torch.zeros(self.num_envs, dtype=torch.float64)
        self._record: dict[int | str, np.ndarray] | None = None
        self._kinematics = Kinematics(robot, self.num_envs, self.batch.nthread)

    def _model(self, obj: SceneObject) -> mujoco.MjModel:
        """Compile a scene, or take it from those at hand."""
        if obj.id not in self._compiled:
            # scenes hold on to what they run on; of other objects the latest are kept, so that memory is bounded
            # however many come by
            while len(self._compiled) >= max(KEPT_MODELS, 2 * self.num_envs):
                del self._compiled[next(iter(self._compiled))]
            self._compiled[obj.id] = compile_scene(self.robot, obj, self.config, self._meshes)
        return self._compiled[obj.id]

    def model(self, env: int) -> mujoco.MjModel:
        """The compiled scene `env`, for rendering or replaying it."""
        return self._models[env]

    def qpos(self) -> np.ndarray:
        """(N, nq) live view of MuJoCo's positions: root, joints, then the object's if it moves."""
        return self._qpos

    def qvel(self) -> np.ndarray:
        """(N, nv) live view of MuJoCo's velocities."""
        return self._qvel

    @property
    def objects(self) -> list[SceneObject]:
        """The object in each scene."""
        return [self.catalog[place] for place in self.object_index.tolist()]

    def add_objects(self, objects: Sequence[SceneObject]) -> list[int]:
        """Places of objects in the catalog, at whose end those are put that it lacks; see Physics.add_objects."""
        for obj in objects:
            if obj.hulls and not self._meshes:
                raise MimicbenchError(
                    f"object {obj.id} has convex pieces, and this simulation has room for boxes only; make it with "
                    "PhysicsConfig(meshes=True)"
                )
            if obj.movable != self._movable:
                kind = "movable" if obj.movable else "fixed"
                raise BadObject(f"object {obj.id} is {kind} and others are not; simulate them apart")
        return catalogued(self.catalog, self._places, objects)

    def set_objects(self, rows: Rows, index: torch.Tensor) -> None:
        """Exchange the objects of scenes `rows` for those at `index` (n,) of the catalog."""
        if not len(rows):
            return
        rows.put(self.object_index, index)
        for env, place in zip(rows.ids.tolist(), index.tolist(), strict=True):
            self._models[env] = self._model(self.catalog[place])
        self.batch.set_models(self._models)

    def reset(self, rows: Rows, robot: RobotState, obj: ObjectState | None = None) -> None:
        """Put scenes `rows` into a state of n robots and objects; objects go to the origin if None."""
        ids = rows.ids.numpy()
        if not len(ids):
            return
        self.batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        qpos, qvel = self._qpos, self._qvel
        qpos[ids, :3], qpos[ids, 3:7], qpos[ids, self._joint_q] = robot.root_pos_w, robot.root_quat_w, robot.joint_pos
        qvel[ids, :3], qvel[ids, 3:6], qvel[ids, self._joint_v] = (
            robot.root_lin_vel_w,
            robot.root_ang_vel_b,
            robot.joint_vel,
        )
        if obj is not None and self._movable:
            qpos[ids, self._object_q] = np.concatenate([obj.pos_w.numpy(), obj.quat_w.numpy()], 1)
            qvel[ids, self._object_v] = np.concatenate([obj.lin_vel_w.numpy(), obj.ang_vel_b.numpy()], 1)
        for there in (self._wrench, self._forces):
            if there is not None:
                there[ids] = 0.0
        self._warned[ids], self._reported[ids] = self._warnings()[ids], False
        self._diverged = self._diverged.copy()  # whoever holds what it was keeps it
        self._diverged[ids] = False

    def step(self, target: torch.Tensor, measure_effort: bool = False, running: torch.Tensor | None = None) -> None:
        """Advance scenes `running` (N,) bool (None: all) one control step; see Physics.step."""
        ids = None if running is None or bool(running.all()) else np.flatnonzero(running.numpy())
        if ids is not None and not len(ids):
            return
        for before, now in zip(self._before, (self._qpos, self._qvel, self._warmstart), strict=True):
            before[:] = now
        self._ctrl[:] = target.numpy()
        if measure_effort:
            count = self.num_envs if ids is None else len(ids)
            there = None if self._record is None else {name: array[:count] for name, array in self._record.items()}
            record = self.batch.rollout(SUBSTEPS, record=_RECORDED, ids=ids, out=there)
            if ids is None:
                self._record = record  # the next step writes there again
            effort = effort_of(record["actuator_force"], record["qvel"][..., self._joint_v])
            self._effort[slice(None) if ids is None else torch.from_numpy(ids)] = torch.from_numpy(effort)
        else:
            self.batch.step(ids, nstep=SUBSTEPS)
        if self._forces is not None and self._sensors is not None:
            stepped = slice(None) if ids is None else ids
            self._forces[stepped] = self._sensors[stepped]
        self._report(target)

    def _report(self, target: torch.Tensor) -> None:
        """Tell of scenes that broke in this step, once each."""
        self._diverged = self._warnings() > self._warned
        for env in np.flatnonzero(self._diverged & ~self._reported).tolist():
            self._reported[env] = True
            counts = self.batch.warning[env, _KINDS, 1]
            reason = " and ".join(told for told, count in zip(_WARNINGS.values(), counts, strict=True) if count)
            qpos, qvel, warmstart = (array[env].copy() for array in self._before)
            config, obj = self.config, self.catalog[int(self.object_index[env])]
            scene = env, "native", self.robot.name, config.gains, config.control, obj
            wrench = np.zeros(6) if self._wrench is None else self._wrench[env].copy()
            state = qpos, qvel, warmstart, target[env].numpy().astype(float), wrench
            self.broken.add(BrokenScene(reason, *scene, *state, config.friction, config.mass))

    def advance(self, target: torch.Tensor) -> None:
        """One control step of all scenes and nothing else; see Physics.advance."""
        self.batch.ctrl = target.numpy()
        self.batch.step(nstep=SUBSTEPS)

    def state(self) -> RobotState:
        """Joint-space state now."""
        qpos, qvel = self._qpos.astype(np.float32), self._qvel.astype(np.float32)
        parts = qpos[:, :3], qpos[:, 3:7], qvel[:, :3], qvel[:, 3:6], qpos[:, self._joint_q], qvel[:, self._joint_v]
        return RobotState(*(torch.from_numpy(part) for part in parts))  # slices of arrays cost less than of tensors

    def links(self) -> LinkState:
        """Poses and velocities of all links now."""
        return self._kinematics.links(self._qpos, self._qvel)

    def link_poses(self) -> LinkPoses:
        """Poses of all links now."""
        return self._kinematics.poses(self._qpos)

    def object_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3) [m] and orientations (N, 4) of the objects now; the origin where they do not move."""
        if not self._movable:
            return np.zeros((self.num_envs, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (self.num_envs, 1))
        pose = self._qpos[:, self._object_q]
        return pose[:, :3].copy(), pose[:, 3:].copy()

    def object_state(self) -> ObjectState:
        """Where the objects are now."""
        if not self._movable:
            return ObjectState.at_origin(self.num_envs)
        pose, velocity = (
            torch.from_numpy(array.astype(np.float32))
            for array in (self._qpos[:, self._object_q], self._qvel[:, self._object_v])
        )
        return ObjectState(pose[:, :3], pose[:, 3:], velocity[:, :3], velocity[:, 3:])

    def ray(
        self, starts: np.ndarray, rays: np.ndarray, groups: Sequence[int], ids: np.ndarray | None = None
    ) -> np.ndarray:
        """For scenes `ids`, how many lengths of each ray it is to a geom; see Physics.ray."""
        seen = np.zeros(mujoco.mjNGROUP, np.uint8)
        seen[list(groups)] = 1
        return self.batch.ray(starts, rays, geomgroup=seen, ids=ids)[0]

    def push(self, lin_vel_w: torch.Tensor) -> None:
        """Add (N, 3) [m/s] to the roots' velocities."""
        self._qvel[:, :3] += lin_vel_w.numpy()

    def assist(self, force_w: torch.Tensor, torque_w: torch.Tensor) -> None:
        """Forces (N, 3) [N] and torques (N, 3) [N m] on the roots, until they are set anew; see Physics.assist."""
        wrench = self._wrench
        if wrench is None:  # bound only where somebody assists: what is bound is copied in every step
            wrench = self._wrench = self.batch.bind("xfrc_applied").reshape(self.num_envs, -1, 6)[:, self._root]
        wrench[:, :3], wrench[:, 3:] = force_w.numpy(), torque_w.numpy()

    def state_tensors(self) -> dict[str, torch.Tensor]:
        """All that decides how the simulation goes on, to the last bit."""
        tensors = {"qpos": self._qpos, "qvel": self._qvel, "warmstart": self._warmstart}
        if self._wrench is not None:
            tensors["wrench"] = self._wrench
        if self._forces is not None:
            tensors["forces"] = self._forces
        copies = {name: torch.from_numpy(array.copy()) for name, array in tensors.items()}
        return {**copies, "object_index": self.object_index.clone(), "effort": self._effort.clone()}

    def load_state_tensors(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """The inverse of `state_tensors`, with the same catalog."""
        every = Rows.every(self.num_envs)
        self.set_objects(every, tensors["object_index"])
        self.batch.reset(every.ids.numpy(), stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        for name, there in (("qpos", self._qpos), ("qvel", self._qvel), ("warmstart", self._warmstart)):
            there[:] = tensors[name].numpy()
        if "wrench" in tensors:
            self.assist(tensors["wrench"][:, :3], tensors["wrench"][:, 3:])
        if self._forces is not None:
            self._forces[:] = tensors["forces"].numpy()
        self._effort.copy_(tensors["effort"])
        self._warned[:], self._reported[:] = self._warnings(), False
        self._diverged = np.zeros(self.num_envs, bool)

    def contact_force(self) -> torch.Tensor:
        """(N, L, 3) forces on links in the last physics step [N]; see Physics.contact_force."""
        if self._forces is None:
            raise not_measured()
        return SIGN * torch.from_numpy(self._forces.astype(np.float32)).unflatten(-1, (-1, 3))

    def report(self) -> None:
        """Nothing to do: every step reports what it broke."""

    @property
    def effort(self) -> torch.Tensor:
        """(N,) e of the last step that measured it [W^2]."""
        return self._effort

    @property
    def diverged(self) -> torch.Tensor:
        """(N,) whether MuJoCo warned of a scene since its reset; see Physics.diverged."""
        return torch.from_numpy(self._diverged)

    def _warnings(self) -> np.ndarray:
        return self.batch.warning[:, :, 1].sum(-1)
