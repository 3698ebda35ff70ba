"""Physics on CPU threads: `mujoco.batch`. Results are the same bits at any number of threads."""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.parallel import cpu_count
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.broken import BrokenLog, BrokenScene
from mimicbench.sim.kinematics import Kinematics
from mimicbench.sim.physics import LinkState, RobotState
from mimicbench.sim.scene import SUBSTEPS, build_model

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
KEPT_MODELS = 2048
"""Compiled scenes that a simulation keeps for objects that may come again, of about 55 kB each."""


class NativePhysics:
    """N scenes on `workers` threads (0: all processors). See the Physics protocol for the methods."""

    def __init__(
        self,
        robot: Robot,
        objects: Sequence[SceneObject],
        preset: str = "improved",
        control: str = "position",
        workers: int = 0,
        visuals: bool = False,
        meshes: bool | None = None,
        broken_dir: Path | None = None,
    ) -> None:
        self.robot, self.num_envs, self.device = robot, len(objects), "cpu"
        self._preset, self._control, self._visuals = preset, control, visuals
        # room for imported objects' convex pieces, now or by set_objects; by default if there are any now
        self._meshes = any(obj.hulls for obj in objects) if meshes is None else meshes
        self._compiled: dict[str, mujoco.MjModel] = {}
        self.objects: Sequence[SceneObject] = list(objects)
        models = [self._model(obj) for obj in objects]
        self.batch = Batch(models[0], self.num_envs, min(workers or cpu_count(), self.num_envs))
        self._models = models
        self.batch.set_models(models)
        joints = len(robot.joints)
        self._qpos, self._qvel, self._ctrl = self.batch.bind("qpos"), self.batch.bind("qvel"), self.batch.bind("ctrl")
        self._joint_q, self._joint_v = slice(7, 7 + joints), slice(6, 6 + joints)
        self.broken = BrokenLog(broken_dir)
        self._warmstart = self.batch.bind("qacc_warmstart")
        self._before = [array.copy() for array in (self._qpos, self._qvel, self._warmstart)]
        self._warned, self._reported = np.zeros(self.num_envs, np.int64), np.zeros(self.num_envs, bool)
        self._effort = torch.zeros(self.num_envs, dtype=torch.float64)
        self._kinematics = Kinematics(robot, self.num_envs, self.batch.nthread)

    def _model(self, obj: SceneObject) -> mujoco.MjModel:
        """Compile a scene, or take it from those at hand."""
        if obj.hulls and not self._meshes:
            raise MimicbenchError(
                f"object {obj.id} has convex pieces, and this simulation has room for boxes only; "
                "make it with meshes=True"
            )
        if obj.id not in self._compiled:
            # scenes hold on to what they run on; of other objects the latest are kept, so that memory is bounded
            # however many come by
            while len(self._compiled) >= max(KEPT_MODELS, 2 * self.num_envs):
                del self._compiled[next(iter(self._compiled))]
            self._compiled[obj.id] = build_model(
                self.robot, obj, self._preset, self._control, self._visuals, self._meshes
            )
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

    def set_objects(self, objects: Sequence[SceneObject], ids: np.ndarray | None = None) -> None:
        """Exchange the objects of scenes `ids` (None: all).

        Scenes of movable and fixed objects cannot share a batch.
        """
        scene = list(self.objects)
        for env, obj in zip(range(self.num_envs) if ids is None else ids, objects, strict=True):
            self._models[env] = self._model(obj)
            scene[env] = obj
        self.objects = scene
        self.batch.set_models(self._models)

    def reset(
        self,
        ids: np.ndarray,
        root_pos_w: np.ndarray,
        root_quat_w: np.ndarray,
        joint_pos: np.ndarray,
        root_lin_vel_w: np.ndarray | None = None,
        root_ang_vel_b: np.ndarray | None = None,
        joint_vel: np.ndarray | None = None,
    ) -> None:
        """Put the robots of scenes `ids` into a state; velocities default to zero, objects return to the origin."""
        if not len(ids):
            return
        self.batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self._qpos[ids, :3], self._qpos[ids, 3:7], self._qpos[ids, self._joint_q] = root_pos_w, root_quat_w, joint_pos
        if root_lin_vel_w is not None:
            self._qvel[ids, :3] = root_lin_vel_w
        if root_ang_vel_b is not None:
            self._qvel[ids, 3:6] = root_ang_vel_b
        if joint_vel is not None:
            self._qvel[ids, self._joint_v] = joint_vel
        self._warned[ids], self._reported[ids] = self._warnings()[ids], False

    def step(self, target: torch.Tensor, measure_effort: bool = False, ids: np.ndarray | None = None) -> None:
        """Advance scenes `ids` (None: all) one control step; see Physics.step."""
        for before, now in zip(self._before, (self._qpos, self._qvel, self._warmstart), strict=True):
            before[:] = now
        self._ctrl[:] = target.numpy()
        if measure_effort:
            record = self.batch.rollout(SUBSTEPS, record=("actuator_force", "qvel"), ids=ids)
            torque, velocity = (
                _mean_of_substeps(part) for part in (record["actuator_force"], record["qvel"][..., self._joint_v])
            )
            self._effort[slice(None) if ids is None else torch.from_numpy(ids)] = torch.from_numpy(
                ((torque * velocity) ** 2).sum(-1)
            )
        else:
            self.batch.step(ids, nstep=SUBSTEPS)
        self._report(target)

    def _report(self, target: torch.Tensor) -> None:
        """Tell of scenes that broke in this step, once each."""
        for env in np.flatnonzero((self._warnings() > self._warned) & ~self._reported).tolist():
            self._reported[env] = True
            counts = self.batch.warning[env, _KINDS, 1]
            reason = " and ".join(told for told, count in zip(_WARNINGS.values(), counts, strict=True) if count)
            qpos, qvel, warmstart = (array[env].copy() for array in self._before)
            self.broken.add(
                BrokenScene(
                    reason,
                    env,
                    "native",
                    self.robot.name,
                    self._preset,
                    self._control,
                    self.objects[env],
                    qpos,
                    qvel,
                    warmstart,
                    target[env].numpy().astype(float),
                )
            )

    def advance(self, target: torch.Tensor) -> None:
        """One control step of all scenes and nothing else; see Physics.advance."""
        self.batch.ctrl = target.numpy()
        self.batch.step(nstep=SUBSTEPS)

    def state(self) -> RobotState:
        """Joint-space state now."""
        qpos, qvel = torch.from_numpy(self._qpos.astype(np.float32)), torch.from_numpy(self._qvel.astype(np.float32))
        return RobotState(
            qpos[:, :3], qpos[:, 3:7], qvel[:, :3], qvel[:, 3:6], qpos[:, self._joint_q], qvel[:, self._joint_v]
        )

    def links(self) -> LinkState:
        """Poses and velocities of all links now."""
        return self._kinematics.links(self._qpos, self._qvel)

    def object_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3) [m] and orientations (N, 4) of the objects now; the origin where they do not move."""
        if not self.objects[0].movable:
            return np.zeros((self.num_envs, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (self.num_envs, 1))
        pose = self._qpos[:, self._joint_q.stop :]
        return pose[:, :3].copy(), pose[:, 3:7].copy()

    def ray(
        self, starts: np.ndarray, rays: np.ndarray, groups: Sequence[int], ids: np.ndarray | None = None
    ) -> np.ndarray:
        """For scenes `ids`, how many lengths of each ray it is to a geom; see Physics.ray."""
        seen = np.zeros(mujoco.mjNGROUP, np.uint8)
        seen[list(groups)] = 1
        return self.batch.ray(starts, rays, geomgroup=seen, ids=ids)[0]

    def push(self, ids: np.ndarray, lin_vel_w: np.ndarray) -> None:
        """Add (n, 3) [m/s] to the root's velocity in scenes `ids`."""
        self._qvel[ids, :3] += lin_vel_w

    @property
    def effort(self) -> torch.Tensor:
        """(N,) e of the last step that measured it [W^2]."""
        return self._effort

    @property
    def diverged(self) -> torch.Tensor:
        """(N,) whether MuJoCo warned of a scene since its reset; see Physics.diverged."""
        return torch.from_numpy(self._warnings() > self._warned)

    def _warnings(self) -> np.ndarray:
        return self.batch.warning[:, _KINDS, 1].sum(-1)


def _mean_of_substeps(values: np.ndarray) -> np.ndarray:
    """(N, J) mean of (N, SUBSTEPS, J), several times as fast as `mean` over so short an axis."""
    total = values[:, 0].copy()
    for i in range(1, SUBSTEPS):
        total += values[:, i]
    return total / SUBSTEPS
