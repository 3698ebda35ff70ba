"""Physics by MuJoCo Warp, on an NVIDIA GPU; without one, slowly, on Warp's own CPU device.

All worlds share one model whose arrays that depend on the object have a row per world, so an object is exchanged by
writing rows. Warp shares the types of geoms between worlds: objects are boxes here, imported convex pieces are refused.
Numbers have 32 bits, and a GPU adds up in no fixed order: unlike the native backend, two runs need not be the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import mujoco
import mujoco_warp as mjw  # pyright: ignore[reportMissingImports]
import numpy as np
import torch
import warp as wp  # pyright: ignore[reportMissingImports]

from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.broken import BrokenLog, BrokenScene
from mimicbench.sim.contact import SIGN, not_measured
from mimicbench.sim.physics import LinkState, ObjectState, PhysicsConfig, RobotState, compile_scene
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import SUBSTEPS
from mimicbench.sim.warp_breaks import Breaks
from mimicbench.sim.warp_device import open_device, program, read_only
from mimicbench.sim.warp_kernels import accumulate, guard
from mimicbench.sim.warp_objects import PER_WORLD, ObjectRows, object_places
from mimicbench.sim.warp_rays import cast_rays

CONTACTS = 64
"""Contacts that a world has room for. Measured: 26 at most, of limp robots thrown onto furniture of every family."""
_ROWS_PER_CONTACT = 4  # pyramidal friction cones
_MODELS_KEPT = 64
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
        base = compile_scene(robot, objects[0], replace(self.config, visuals=False))
        joints = len(robot.joints)
        self._joint_q, self._joint_v = slice(7, 7 + joints), slice(6, 6 + joints)
        self._object_q, self._object_v = slice(7 + joints, 14 + joints), slice(6 + joints, 12 + joints)
        self._movable = objects[0].movable
        self._places = object_places(base, joints)
        root = base.body(robot.link_names[0]).id
        self._link_rows = slice(root, root + len(robot.link_names))  # links are consecutive bodies, in order
        self.object_index = torch.zeros(self.num_envs, dtype=torch.long, device=device)
        with wp.ScopedDevice(self._wp_device):
            self._make(base, contacts)
        self._objects = ObjectRows(self._movable, device, self.config.friction)
        self.catalog = self._objects.catalog
        every = Rows.every(self.num_envs, device)
        self.set_objects(every, torch.tensor(self.add_objects(objects), device=device))
        self._qpos0 = torch.from_numpy(base.qpos0.astype(np.float32)).to(device)
        self._substeps = program(self._wp_device, self._run_substeps)
        self._kinematics = program(self._wp_device, self._run_kinematics)
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
        self._forces = wp.to_torch(self._data.sensordata) if self.config.measure_contact else None
        self._broken_wp = wp.zeros(n, dtype=int)
        self._torque_wp, self._velocity_wp = wp.zeros((n, joints), dtype=float), wp.zeros((n, joints), dtype=float)
        self._broken, self._torque, self._velocity = (
            wp.to_torch(array) for array in (self._broken_wp, self._torque_wp, self._velocity_wp)
        )
        self._breaks = Breaks(self._broken, [*self._state, self._ctrl, self._wrench, self.object_index])
        self._effort = torch.zeros(n, dtype=torch.float64, device=self.device)

    def _run_substeps(self) -> None:
        model, data, joints = self._model, self._data, len(self.robot.joints)
        broken = self._broken_wp
        check = [model.qpos0, _OVERFLOWS, data.qpos, data.qvel, data.ctrl, data.qacc_warmstart, data.overflow, broken]
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
            self._models[obj.id] = compile_scene(self.robot, obj, self.config)
        return self._models[obj.id]

    def qpos(self) -> np.ndarray:
        """(N, nq) copy of MuJoCo's positions, which cannot be written to: root, joints, then a movable object's."""
        return read_only(self._qpos)

    def qvel(self) -> np.ndarray:
        """(N, nv) copy of MuJoCo's velocities, which cannot be written to."""
        return read_only(self._qvel)

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
        return self._objects.add(objects)

    def set_objects(self, rows: Rows, index: torch.Tensor) -> None:
        """Exchange the objects of scenes `rows` for those at `index` (n,) of the catalog."""
        rows.put(self.object_index, index)
        for name, place in self._places.items():
            rows.put(wp.to_torch(getattr(self._model, name))[:, place], self._objects.rows[name][index])
        if not self._movable:  # Warp places what cannot move only once
            for there, name in ((self._data.geom_xpos, "geom_pos"), (self._data.geom_xmat, "geom_xmat")):
                rows.put(wp.to_torch(there)[:, self._places["geom_pos"]], self._objects.rows[name][index])

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
        for there in (self._qvel, self._warmstart, self._ctrl, self._wrench, self._forces):
            if there is not None:
                rows.put(there, 0.0)
        rows.put(self._broken, 0)
        self._breaks.forget(rows)

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
        self._breaks.notice(self._broken, [*self._before, target, self._wrench, self.object_index])

    def report(self) -> None:
        """Tell of scenes that broke since the last report; of one that did so twice, the last time."""
        for env, reason, (*state, wrench, place) in self._breaks.taken():
            config, obj = self.config, self.catalog[int(place)]
            scene = env, "warp", self.robot.name, config.gains, config.control, obj
            self._broken_log.add(BrokenScene(reason, *scene, *state, wrench, config.friction, config.mass))

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
        data, rows = self._data, self._link_rows
        xpos, xquat, cvel, com = map(wp.to_torch, (data.xpos, data.xquat, data.cvel, data.subtree_com))
        pos, ang = xpos[:, rows].clone(), cvel[:, rows, :3].clone()
        # MuJoCo's cvel is (angular, linear) about the tree's center of mass, in world axes
        lin = cvel[:, rows, 3:] + torch.linalg.cross(ang, pos - com[:, rows.start, None])
        return LinkState(pos, xquat[:, rows].clone(), lin, ang)

    link_poses = links

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
        worlds = np.arange(self.num_envs) if ids is None else np.asarray(ids)
        index = torch.from_numpy(worlds).to(self.device)
        self._kinematics()
        with wp.ScopedDevice(self._wp_device):
            return cast_rays(self._model, self._data, index, starts, rays, groups)

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

    def contact_force(self) -> torch.Tensor:
        """(N, L, 3) forces on links in the last physics step [N]; see Physics.contact_force."""
        if self._forces is None:
            raise not_measured()
        return SIGN * self._forces.unflatten(-1, (-1, 3))

    @property
    def effort(self) -> torch.Tensor:
        """(N,) e of the last step that measured it [W^2]."""
        return self._effort

    @property
    def diverged(self) -> torch.Tensor:
        """(N,) whether a scene broke since its reset; see Physics.diverged."""
        return self._broken != 0
