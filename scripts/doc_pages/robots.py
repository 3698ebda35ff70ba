"""Tables of a robot: its joints, their limits, and the gains that drive them."""

from doc_pages.words import table
from mimicbench.robots.description import Robot


def joints_table(robot: Robot) -> str:
    """Every joint in the order of actions and observations: which link it drives, and its limits."""
    rows = (
        (
            number,
            f"`{joint.name}`",
            f"`{robot.links[joint.link].name}`",
            f"{joint.range[0]:g} to {joint.range[1]:g}",
            f"{joint.torque_limit:g}",
            f"{joint.velocity_limit:g}",
            f"{rest:g}",
        )
        for number, (joint, rest) in enumerate(zip(robot.joints, robot.rest_pose, strict=True))
    )
    head = ("", "joint", "drives", "range [rad]", "torque limit [N m]", "velocity limit [rad/s]", "rest pose [rad]")
    return table(head, rows)


def gains_table(robot: Robot) -> str:
    """kp, kd and the scale of actions of every joint, by the name of the gains."""
    head = ("joint", *(f"`{name}`: {what}" for name in robot.gains for what in ("kp", "kd", "action scale")))
    rows = [
        (f"`{joint.name}`", *(f"{v[number]:g}" for g in robot.gains.values() for v in (g.kp, g.kd, g.action_scale)))
        for number, joint in enumerate(robot.joints)
    ]
    return table(head, rows)
