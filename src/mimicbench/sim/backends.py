"""Which simulator computes the physics. Everything else asks for a device and gets the interface."""

from collections.abc import Sequence

from mimicbench.core.errors import MimicbenchError
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.devices import CPU, tensor_device
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import Physics, PhysicsConfig


def make_physics(
    device: str, robot: Robot, objects: Sequence[SceneObject], config: PhysicsConfig | None = None, workers: int = 0
) -> Physics:
    """N scenes of one robot, one per object, on a device.

    Args:
        device: `cpu` (MuJoCo on threads), `cuda` or `cuda:1` (MuJoCo Warp on a GPU), or `warp-cpu` (MuJoCo Warp without
            one: slow, for tests).
        robot: the robot.
        objects: one for each scene; others may be added to the catalog later.
        config: gains, control, and what there is to be room for.
        workers: threads on `cpu`, 0: all processors; Warp has none.

    Raises:
        UnknownName: there is no such device.
        MimicbenchError: Warp is not installed, or there is no such GPU, or an object does not fit the backend.
    """
    if device == CPU:
        return NativePhysics(robot, objects, config, workers)
    check_device(device)
    from mimicbench.sim.warp import WarpPhysics

    return WarpPhysics(robot, objects, config, tensor_device(device))


def check_device(device: str) -> None:
    """Find out whether there is such a device here before hours of work end at it. Raises as make_physics does."""
    tensors = tensor_device(device)
    if device == CPU:
        return
    try:
        from mimicbench.sim.warp import open_device
    except ModuleNotFoundError as error:
        if error.name not in ("warp", "mujoco_warp"):
            raise
        raise MimicbenchError(
            f"device {device} needs MuJoCo Warp; run `pip install 'mimicbench[gpu]'`, or use --device cpu"
        ) from None
    open_device(tensors)
