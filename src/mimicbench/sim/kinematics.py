"""Where the links of many robots are, and how they move, from nothing but the robots' own coordinates.

MuJoCo can say so of a whole scene, but then it also looks for contacts, which costs three times as much. Here the
robots have no shapes and nothing beside them; the numbers are the same to the last bit.
"""

from collections.abc import Iterator

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from mimicbench.robots.description import Robot
from mimicbench.sim.physics import LinkPoses, LinkState
from mimicbench.sim.scene import add_links

_SENSORS = {
    mujoco.mjtSensor.mjSENS_FRAMEPOS: 3,
    mujoco.mjtSensor.mjSENS_FRAMEQUAT: 4,
    mujoco.mjtSensor.mjSENS_FRAMELINVEL: 3,
    mujoco.mjtSensor.mjSENS_FRAMEANGVEL: 3,
}
"""What is read of every link, in LinkState's order, and how many numbers each is."""
_OFF = (
    mujoco.mjtDisableBit.mjDSBL_CONTACT,
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    mujoco.mjtDisableBit.mjDSBL_ACTUATION,
    mujoco.mjtDisableBit.mjDSBL_SPRING,
    mujoco.mjtDisableBit.mjDSBL_DAMPER,
)
"""Only the robot's tree matters; forces would be worked out for nothing."""


class Kinematics:
    """The links of N robots, on threads."""

    def __init__(self, robot: Robot, num_envs: int, workers: int) -> None:
        self._links, self._num_envs = len(robot.links), num_envs
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.disableflags = sum(bit.value for bit in _OFF)
        add_links(spec, robot)
        for sensor in _SENSORS:
            for name in robot.link_names:
                spec.add_sensor(type=sensor, objtype=mujoco.mjtObj.mjOBJ_XBODY, objname=name)
        self._batch = Batch(spec.compile(), num_envs, workers)
        self._qpos, self._qvel, self._seen = (self._batch.bind(field) for field in ("qpos", "qvel", "sensordata"))

    def links(self, qpos: np.ndarray, qvel: np.ndarray) -> LinkState:
        """Poses and velocities of all links.

        Args:
            qpos: (N, 7 + J or more) MuJoCo's positions; what follows the robot's is left out.
            qvel: (N, 6 + J or more) MuJoCo's velocities.
        """
        self._qpos[:], self._qvel[:] = qpos[:, : self._qpos.shape[1]], qvel[:, : self._qvel.shape[1]]
        self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
        return LinkState(*self._read(*_SENSORS.values()))

    def poses(self, qpos: np.ndarray) -> LinkPoses:
        """Poses alone of all links, which costs two thirds; `qpos` as in `links`."""
        self._qpos[:] = qpos[:, : self._qpos.shape[1]]
        self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_POS.value)
        return LinkPoses(*self._read(*list(_SENSORS.values())[:2]))

    def _read(self, *sizes: int) -> Iterator[torch.Tensor]:
        """(N, L, size) of the first sensors."""
        # each number of all robots side by side: what is worked out of it then runs along the robots
        seen = np.ascontiguousarray(self._seen[:, : self._links * sum(sizes)].astype(np.float32).T)
        first = 0
        for size in sizes:
            part = seen[first : first + self._links * size].reshape(self._links, size, self._num_envs)
            yield torch.from_numpy(part.transpose(2, 0, 1))
            first += self._links * size
