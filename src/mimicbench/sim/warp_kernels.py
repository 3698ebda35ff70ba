# These functions are Warp's language, which looks like Python but has types of its own.
# pyright: reportMissingImports=false, reportIndexIssue=false, reportOperatorIssue=false, reportAttributeAccessIssue=false
# pyright: reportAssignmentType=false, reportGeneralTypeIssues=false
"""What runs in each world beside MuJoCo Warp itself: finding broken worlds, and means over substeps."""

import mujoco
import warp as wp

BAD_POSITION, BAD_VELOCITY, BAD_TARGET, OVERFLOW = 1, 2, 4, 8
"""Marks of a broken world."""
_TOO_LARGE = wp.constant(mujoco.mjMAXVAL)
_PARKED = wp.constant(5.0)  # [m] height of a broken world's robot, away from all that it could touch


@wp.kernel(enable_backward=False)
def guard(
    qpos0: wp.array2d[float],
    overflows: int,
    qpos: wp.array2d[float],
    qvel: wp.array2d[float],
    ctrl: wp.array2d[float],
    warmstart: wp.array2d[float],
    overflow: wp.array[int],
    broken: wp.array[int],
) -> None:
    """Mark broken worlds, and park them before what is not finite reaches anything that worlds share."""
    world = wp.tid()
    found = wp.int32(0)
    for i in range(qpos.shape[1]):
        if not (wp.abs(qpos[world, i]) < _TOO_LARGE):
            found |= wp.static(BAD_POSITION)
    for i in range(qvel.shape[1]):
        if not (wp.abs(qvel[world, i]) < _TOO_LARGE):
            found |= wp.static(BAD_VELOCITY)
    for i in range(ctrl.shape[1]):
        if not (wp.abs(ctrl[world, i]) < _TOO_LARGE):
            found |= wp.static(BAD_TARGET)
            ctrl[world, i] = 0.0
    if found != 0:
        for i in range(qpos.shape[1]):
            qpos[world, i] = qpos0[0, i]
        qpos[world, 2] = _PARKED
        for i in range(qvel.shape[1]):
            qvel[world, i] = 0.0
            warmstart[world, i] = 0.0
    if (overflow[world] & overflows) != 0:
        found |= wp.static(OVERFLOW)
    overflow[world] = 0
    broken[world] = broken[world] | found


@wp.kernel(enable_backward=False)
def accumulate(
    actuator_force: wp.array2d[float],
    qvel: wp.array2d[float],
    first_joint: int,
    torque: wp.array2d[float],
    velocity: wp.array2d[float],
) -> None:
    """Sum torques and velocities of the joints over the substeps."""
    world, joint = wp.tid()
    torque[world, joint] = torque[world, joint] + actuator_force[world, joint]
    velocity[world, joint] = velocity[world, joint] + qvel[world, first_joint + joint]
