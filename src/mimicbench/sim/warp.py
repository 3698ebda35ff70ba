"""Physics by MuJoCo Warp, on an NVIDIA GPU; without one, slowly, on Warp's own CPU device.

All worlds share one model whose arrays that depend on the object have a row per world, so an object is exchanged by
writing rows. Warp shares the types of geoms between worlds: objects are boxes here, imported convex pieces are refused.
Numbers have 32 bits, and a GPU adds up in no fixed order: unlike the native backend, two runs need not be the same.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any

import mujoco
import mujoco_warp as mjw  # pyright: ignore[reportMissingImports]
import numpy as np
import torch
import warp as wp  # pyright: ignore[reportMissingImports]

from mimicbench.core.errors import BadObject, MimicbenchError
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.broken import BrokenLog, BrokenScene
from mimicbench.sim.native import catalogued
from mimicbench.sim.physics import LinkState, ObjectState, PhysicsConfig, RobotState
from mimicbench.sim.rows import Rows
from mimicbench.sim.scene import OBJECT_BODY, SUBSTEPS, build_model, build_object
from mimicbench.sim.warp_kernels import BAD_POSITION, BAD_TARGET, BAD_VELOCITY, OVERFLOW, accumulate, guard

CONTACTS = 64
"""Contacts that a world has room for. Measured: 26 at most, of limp robots thrown onto furniture of every family."""
_ROWS_PER_CONTACT = 4  # pyramidal friction cones
_GEOM_FIELDS = ("geom_pos", "geom_quat", "geom_size", "geom_rbound", "geom_aabb", "geom_friction")
_BODY_FIELDS = ("body_mass", "body_subtreemass", "body_inertia", "body_ipos", "body_iquat", "body_invweight0")
_DOF_FIELDS = ("dof_invweight0",)
PER_WORLD = (*_GEOM_FIELDS, *_BODY_FIELDS, *_DOF_FIELDS)
"""Fields of the model that have a row per world: all that differ between objects and matter to physics."""
_REASONS = {
    BAD_POSITION: "positions are not finite, or too large",
    BAD_VELOCITY: "velocities are not finite, or too large",
    BAD_TARGET: "targets are not finite",
    OVERFLOW: "there are more contacts than room for them",
}
_MODELS_KEPT = 64
_cast: Any = mjw.rays  # its types say less than what Warp's arrays are
_GROUP_MASK = wp.types.vector(length=6, dtype=float)
_OVERFLOWS = sum(int(mjw.OverflowType[name]) for name in ("NEFC", "NJMAX_NNZ", "BROADPHASE", "NARROWPHASE", "CCD"))


class WarpPhysics:
    """N scenes on one device. See the Physics protocol for the methods."""

    asynchronous = True
    workers = 1

    def __init__(
        self,
        robot: Robot,
        objects: Sequence[SceneObject],
        config: PhysicsConfig | None = None,
        device: str = "cuda",
        contacts: int = CONTACTS,
    ) -> None:
        """`contacts` is how many each world has room for; one that needs more is broken."""
        self.robot, self.num_envs, self.device, self.config = robot, len(objects), device, config or PhysicsConfig()
        self._broken_log = BrokenLog(self.config.broken_dir)
        self._wp_device = open_device(device)
        self._models: dict[str, mujoco.MjModel] = {}
        base = build_model(robot, objects[0], self.config.gains, self.config.control)
        joints, body = len(robot.joints), base.body(OBJECT_BODY).id
        self._joint_q, self._joint_v = slice(7, 7 + joints), slice(6, 6 + joints)
        self._object_q, self._object_v = slice(7 + joints, 14 + joints), slice(6 + joints, 12 + joints)
        self._movable = objects[0].movable
        first = int(base.body_geomadr[body])
        self._places = {
            **dict.fromkeys(_GEOM_FIELDS, slice(first, first + int(base.body_geomnum[body]))),
            **dict.fromkeys(_BODY_FIELDS, slice(body, body + 1)),
            **dict.fromkeys(_DOF_FIELDS, slice(6 + joints, base.nv)),
        }
        root = base.body(robot.link_names[0]).id
        self._link_rows = slice(root, root + len(robot.link_names))  # links are consecutive bodies, in order
        with wp.ScopedDevice(self._wp_device):
            self._make(base, contacts)
        self.catalog: list[SceneObject] = []
        self._catalog_places: dict[str, int] = {}
        self._catalog_rows: dict[str, torch.Tensor] = {}
        every = Rows.every(self.num_envs, device)
        self.object_index = torch.zeros(self.num_envs, dtype=torch.long, device=device)
        self.set_objects(every, torch.tensor(self.add_objects(objects), device=device))
        self._qpos0 = torch.from_numpy(base.qpos0.astype(np.float32)).to(device)
        self._substeps = self._program(self._run_substeps)
        self._kinematics = self._program(self._run_kinematics)
        self._clear(every)
        self._still = ObjectState.at_origin(self.num_envs, device)

    def _make(self, base: mujoco.MjModel, contacts: int) -> None:
        n, joints = self.num_envs, len(self.robot.joints)
        self._model = mjw.put_model(base, batch_sizes=dict.fromkeys(PER_WORLD, n))
        self._model.opt.warn_overflow = 0  # it would print; `guard` reads the marks and reports
        rows = _ROWS_PER_CONTACT * contacts + joints
        # contacts of all worlds go into one store: with twice the room, no world can push out another's before it
        # breaks by its own rows
        self._data = mjw.make_data(base, nworld=n, naconmax=2 * contacts * n, njmax=rows)
        self._state = [wp.to_torch(array) for array in (self._data.qpos, self._data.qvel, self._data.qacc_warmstart)]
        self._qpos, self._qvel, self._warmstart = self._state
        self._before = [array.clone() for array in self._state]
        self._ctrl = wp.to_torch(self._data.ctrl)
        self._wrench = wp.to_torch(self._data.xfrc_applied)[:, self._link_rows.start]
        # of worlds that broke: the states before, and the targets of, the steps in which they did
        self._last_good = [*(array.clone() for array in self._state), self._ctrl.clone()]
        self._broken_wp = wp.zeros(n, dtype=int)
        self._torque_wp, self._velocity_wp = wp.zeros((n, joints), dtype=float), wp.zeros((n, joints), dtype=float)
        self._broken, self._torque, self._velocity = (
            wp.to_torch(array) for array in (self._broken_wp, self._torque_wp, self._velocity_wp)
        )
        self._noticed, self._untold = (
            torch.zeros(n, dtype=torch.bool, device=self.device),
            torch.zeros_like(self._broken),
        )
        self._effort = torch.zeros(n, dtype=torch.float64, device=self.device)

    def _program(self, run: Callable[[], None]) -> Callable[[], None]:
        """What does `run`: on a GPU as one captured graph, since launching its kernels one by one costs more than
        they do.
        """
        with wp.ScopedDevice(self._wp_device):
            run()  # compiles
            if not self._wp_device.is_cuda:
                return self._on_device(run)
            with wp.ScopedCapture() as capture:
                run()
        graph = capture.graph
        assert graph is not None
        return lambda: wp.capture_launch(graph)

    def _on_device(self, run: Callable[[], None]) -> Callable[[], None]:
        def there() -> None:
            with wp.ScopedDevice(self._wp_device):
                run()

        return there

    def _run_substeps(self) -> None:
        model, data, joints = self._model, self._data, len(self.robot.joints)
        check = [
            model.qpos0,
            _OVERFLOWS,
            data.qpos,
            data.qvel,
            data.ctrl,
            data.qacc_warmstart,
            data.overflow,
            self._broken_wp,
        ]
        self._torque_wp.zero_()
        self._velocity_wp.zero_()
        for _ in range(SUBSTEPS):
            wp.launch(guard, dim=self.num_envs, inputs=check)
            mjw.step(model, data)
            wp.launch(
                accumulate,
                dim=(self.num_envs, joints),
                inputs=[data.actuator_force, data.qvel, self._joint_v.start, self._torque_wp, self._velocity_wp],
            )
        wp.launch(guard, dim=self.num_envs, inputs=check)

    def _run_kinematics(self) -> None:
        mjw.kinematics(self._model, self._data)
        mjw.com_pos(self._model, self._data)
        mjw.com_vel(self._model, self._data)

    def model(self, env: int) -> mujoco.MjModel:
        """The compiled scene `env`, for rendering or replaying it."""
        obj = self.catalog[int(self.object_index[env])]
        if obj.id not in self._models:
            if len(self._models) >= _MODELS_KEPT:
                self._models.clear()
            config = self.config
            self._models[obj.id] = build_model(self.robot, obj, config.gains, config.control, config.visuals)
        return self._models[obj.id]

    def qpos(self) -> np.ndarray:
        """(N, nq) copy of MuJoCo's positions, which cannot be written to: root, joints, then the object's if it
        moves.
        """
        return _read_only(self._qpos)

    def qvel(self) -> np.ndarray:
        """(N, nv) copy of MuJoCo's velocities, which cannot be written to."""
        return _read_only(self._qvel)

    @property
    def objects(self) -> list[SceneObject]:
        """The object in each scene."""
        return [self.catalog[place] for place in self.object_index.tolist()]

    @property
    def broken(self) -> BrokenLog:
        """What was told of scenes whose physics broke, up to now."""
        self.report()
        return self._broken_log

    def add_objects(self, objects: Sequence[SceneObject]) -> list[int]:
        """Places of objects in the catalog, at whose end those are put that it lacks.

        Raises BadObject for convex pieces, and for movable among fixed ones.
        """
        fresh = [obj for obj in {obj.id: obj for obj in objects}.values() if obj.id not in self._catalog_places]
        rows = [self._rows(obj) for obj in fresh]
        if rows:
            for name in rows[0]:
                new = torch.stack([row[name] for row in rows]).to(self.device)
                old = self._catalog_rows.get(name)
                self._catalog_rows[name] = new if old is None else torch.cat([old, new])
        return catalogued(self.catalog, self._catalog_places, objects)

    def set_objects(self, rows: Rows, index: torch.Tensor) -> None:
        """Exchange the objects of scenes `rows` for those at `index` (n,) of the catalog."""
        rows.put(self.object_index, index)
        for name, place in self._places.items():
            rows.put(wp.to_torch(getattr(self._model, name))[:, place], self._catalog_rows[name][index])
        if not self._movable:  # Warp places what cannot move only once
            for there, name in ((self._data.geom_xpos, "geom_pos"), (self._data.geom_xmat, "geom_xmat")):
                rows.put(wp.to_torch(there)[:, self._places["geom_pos"]], self._catalog_rows[name][index])

    def _rows(self, obj: SceneObject) -> dict[str, torch.Tensor]:
        """What an object has to write into its world."""
        if obj.movable != self._movable:
            raise BadObject(
                f"object {obj.id} is {'movable' if obj.movable else 'fixed'} and others are not; simulate them apart"
            )
        alone = build_object(obj)
        if (alone.geom_type != mujoco.mjtGeom.mjGEOM_BOX).any():
            raise BadObject(
                f"object {obj.id} has convex pieces, which Warp cannot exchange between scenes; use --device cpu for it"
            )
        rows = {name: torch.from_numpy(np.asarray(getattr(alone, name), np.float32)) for name in _GEOM_FIELDS}
        rows |= {name: torch.from_numpy(np.asarray(getattr(alone, name)[1:], np.float32)) for name in _BODY_FIELDS}
        rows |= {name: torch.from_numpy(np.asarray(getattr(alone, name), np.float32)) for name in _DOF_FIELDS}
        rows["geom_aabb"] = rows["geom_aabb"].reshape(-1, 2, 3)
        data = mujoco.MjData(alone)
        mujoco.mj_kinematics(alone, data)
        rows["geom_xmat"] = torch.from_numpy(data.geom_xmat.astype(np.float32)).reshape(-1, 3, 3)
        return rows

    def reset(self, rows: Rows, robot: RobotState, obj: ObjectState | None = None) -> None:
        """Put scenes `rows` into a state of n robots and objects; objects go to the origin if None."""
        self._clear(rows)
        for there, place, given in (
            (self._qpos, slice(0, 3), robot.root_pos_w),
            (self._qpos, slice(3, 7), robot.root_quat_w),
            (self._qpos, self._joint_q, robot.joint_pos),
            (self._qvel, slice(0, 3), robot.root_lin_vel_w),
            (self._qvel, slice(3, 6), robot.root_ang_vel_b),
            (self._qvel, self._joint_v, robot.joint_vel),
        ):
            rows.put(there[:, place], given)
        if obj is not None and self._movable:
            rows.put(self._qpos[:, self._object_q], torch.cat([obj.pos_w, obj.quat_w], 1))
            rows.put(self._qvel[:, self._object_v], torch.cat([obj.lin_vel_w, obj.ang_vel_b], 1))

    def _clear(self, rows: Rows) -> None:
        """Bring scenes to the model's own pose, at rest and unbroken."""
        rows.put(self._qpos, self._qpos0.expand(len(rows), -1))
        for there in (self._qvel, self._warmstart, self._ctrl, self._wrench):
            rows.put(there, 0.0)
        rows.put(self._broken, 0)
        rows.put(self._noticed, False)

    def step(self, target: torch.Tensor, measure_effort: bool = False, running: torch.Tensor | None = None) -> None:
        """Advance scenes `running` (N,) bool (None: all) one control step; see Physics.step."""
        for before, now in zip(self._before, self._state, strict=True):
            before.copy_(now)
        broken = self._broken.clone()
        self._ctrl.copy_(target)
        self._substeps()
        if running is not None:  # all worlds step; those that should not go back
            others = Rows(~running, torch.empty(0), whole=True)
            for before, now in zip([*self._before, broken], [*self._state, self._broken], strict=True):
                others.put(now, before)
        if measure_effort:
            effort = ((self._torque.double() / SUBSTEPS * self._velocity.double() / SUBSTEPS) ** 2).sum(-1)
            self._effort = effort if running is None else torch.where(running, effort, self._effort)
        self._notice(target)

    def _notice(self, target: torch.Tensor) -> None:
        """Keep what it takes to tell of worlds that broke in this step, once each."""
        fresh = (self._broken != 0) & ~self._noticed
        self._noticed |= fresh
        keep = Rows(fresh, torch.empty(0), whole=True)
        for there, value in zip(self._last_good, [*self._before, target], strict=True):
            keep.put(there, value.to(self.device))
        keep.put(self._untold, self._broken)

    def report(self) -> None:
        """Tell of scenes that broke since the last report; of one that did so twice, the last time."""
        for env in (self._untold != 0).nonzero()[:, 0].tolist():
            found = int(self._untold[env])
            qpos, qvel, warmstart, target = (array[env].double().cpu().numpy().copy() for array in self._last_good)
            self._broken_log.add(
                BrokenScene(
                    " and ".join(told for bit, told in _REASONS.items() if found & bit),
                    env,
                    "warp",
                    self.robot.name,
                    self.config.gains,
                    self.config.control,
                    self.catalog[int(self.object_index[env])],
                    qpos,
                    qvel,
                    warmstart,
                    target,
                )
            )
        self._untold.zero_()

    def advance(self, target: torch.Tensor) -> None:
        """One control step of all scenes and nothing else; see Physics.advance."""
        self._ctrl.copy_(target)
        self._substeps()
        wp.synchronize_device(self._wp_device)

    def state(self) -> RobotState:
        """Joint-space state now."""
        qpos, qvel = self._qpos.clone(), self._qvel.clone()
        return RobotState(
            qpos[:, :3], qpos[:, 3:7], qvel[:, :3], qvel[:, 3:6], qpos[:, self._joint_q], qvel[:, self._joint_v]
        )

    def links(self) -> LinkState:
        """Poses and velocities of all links now."""
        self._kinematics()
        rows = self._link_rows
        xpos, xquat, cvel, com = (
            wp.to_torch(array) for array in (self._data.xpos, self._data.xquat, self._data.cvel, self._data.subtree_com)
        )
        pos, ang = xpos[:, rows].clone(), cvel[:, rows, :3].clone()
        # MuJoCo's cvel is (angular, linear) about the tree's center of mass, in world axes
        lin = cvel[:, rows, 3:] + torch.linalg.cross(ang, pos - com[:, rows.start, None])
        return LinkState(pos, xquat[:, rows].clone(), lin, ang)

    def object_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3) [m] and orientations (N, 4) of the objects now; the origin where they do not move."""
        if not self._movable:
            return np.zeros((self.num_envs, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (self.num_envs, 1))
        pose = self._qpos[:, self._object_q].double().cpu().numpy()
        return pose[:, :3].copy(), pose[:, 3:].copy()

    def object_state(self) -> ObjectState:
        """Where the objects are now."""
        if not self._movable:
            return self._still
        pose, velocity = self._qpos[:, self._object_q].clone(), self._qvel[:, self._object_v].clone()
        return ObjectState(pose[:, :3], pose[:, 3:], velocity[:, :3], velocity[:, 3:])

    def ray(
        self, starts: np.ndarray, rays: np.ndarray, groups: Sequence[int], ids: np.ndarray | None = None
    ) -> np.ndarray:
        """For scenes `ids`, how many lengths of each ray it is to a geom; see Physics.ray."""
        index = (
            torch.arange(self.num_envs, device=self.device)
            if ids is None
            else torch.from_numpy(np.asarray(ids)).to(self.device)
        )
        shape = (len(index), rays.shape[1])
        start, ray = (
            torch.from_numpy(np.asarray(given, np.float32)).to(self.device).expand(*shape, 3).contiguous()
            for given in (starts, rays)
        )
        self._kinematics()
        # all that rays meet in those worlds alone: others need not cast any
        model, data = copy(self._model), copy(self._data)
        data.nworld = len(index)
        with wp.ScopedDevice(self._wp_device):
            for owner, name in ((model, "geom_size"), (data, "geom_xpos"), (data, "geom_xmat")):
                rows = getattr(owner, name)
                setattr(owner, name, wp.from_torch(wp.to_torch(rows)[index], dtype=rows.dtype))
            seen = _GROUP_MASK(*(float(group in groups) for group in range(6)))
            nobody = wp.full(rays.shape[1], -1, dtype=int)
            distance, geom, normal = (
                wp.empty(shape, dtype=float),
                wp.empty(shape, dtype=int),
                wp.empty(shape, dtype=wp.vec3),
            )  # pyright: ignore[reportArgumentType]
            _cast(
                model,
                data,
                wp.from_torch(start, dtype=wp.vec3),
                wp.from_torch(ray, dtype=wp.vec3),
                seen,
                True,
                nobody,
                distance,
                geom,
                normal,
            )
        return wp.to_torch(distance).double().cpu().numpy()

    def push(self, lin_vel_w: torch.Tensor) -> None:
        """Add (N, 3) [m/s] to the roots' velocities."""
        self._qvel[:, :3] += lin_vel_w

    def assist(self, force_w: torch.Tensor, torque_w: torch.Tensor) -> None:
        """Forces (N, 3) [N] and torques (N, 3) [N m] on the roots, until they are set anew; see Physics.assist."""
        self._wrench[:, :3], self._wrench[:, 3:] = force_w, torque_w

    def state_tensors(self) -> dict[str, torch.Tensor]:
        """All that decides how the simulation goes on."""
        tensors = {"qpos": self._qpos, "qvel": self._qvel, "warmstart": self._warmstart, "wrench": self._wrench}
        tensors |= {"object_index": self.object_index, "effort": self._effort}
        return {name: value.clone() for name, value in tensors.items()}

    def load_state_tensors(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """The inverse of `state_tensors`, with the same catalog."""
        every = Rows.every(self.num_envs, self.device)
        self.set_objects(every, tensors["object_index"].to(self.device))
        self._clear(every)
        names = ("qpos", "qvel", "warmstart", "wrench")
        for name, there in zip(names, (*self._state, self._wrench), strict=True):
            there.copy_(tensors[name])
        self._effort = tensors["effort"].to(self.device)

    @property
    def effort(self) -> torch.Tensor:
        """(N,) e of the last step that measured it [W^2]."""
        return self._effort

    @property
    def diverged(self) -> torch.Tensor:
        """(N,) whether a scene broke since its reset; see Physics.diverged."""
        return self._broken != 0


def open_device(device: str) -> "wp.Device":
    """Warp's device, after a clear word if there is none."""
    wp.config.log_level = wp.LOG_WARNING
    if device != "cpu" and not torch.cuda.is_available():
        raise MimicbenchError(f"device {device} needs an NVIDIA GPU and the CUDA build of torch; use --device cpu")
    try:
        return wp.get_device(f"cuda:{torch.cuda.current_device()}" if device == "cuda" else device)
    except (ValueError, RuntimeError) as error:
        raise MimicbenchError(f"Warp has no device {device} ({error}); use --device cpu") from None


def _read_only(values: torch.Tensor) -> np.ndarray:
    copy = values.double().cpu().numpy()
    copy.flags.writeable = False
    return copy
