"""Forces of contact on a robot's links, as MuJoCo's own sensors measure them."""

import mujoco

from mimicbench.core.errors import MimicbenchError
from mimicbench.robots.description import Robot

_FORCE = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
_NET = 3
"""MuJoCo's reduction of all contacts to one force, in the world's axes."""
SIGN = -1.0
"""Sensors measure what a link does to everything else; what is done to it is the opposite."""


def add_contact_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """A sensor for every link, in their order: three numbers each, and no others in the scene."""
    for link in robot.link_names:
        sensor = spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_CONTACT, objtype=mujoco.mjtObj.mjOBJ_BODY, objname=link, name=f"{link}.contact"
        )
        sensor.intprm[:3] = _FORCE, _NET, 1


def not_measured() -> MimicbenchError:
    """What to say to those who ask for forces where nobody measures them."""
    return MimicbenchError("forces of contact are not measured here; make the physics with measure_contact=True")
