"""A robot and an object as MJCF, which MuJoCo's own viewer and other people's programs open."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.scene import describe_scene

AWAY = 0.8
"""[m] From the object's front to the robot that stands before it."""
CLEARANCE = 0.002
"""[m] Of its soles over the floor."""
START = "start"
"""What the keyframe is called in which the robot is in its rest pose."""


def scene_xml(robot: Robot, obj: SceneObject, preset: str = "improved", visuals: bool = True) -> str:
    """MJCF of one robot before one object, facing it, as one text that needs no other file.

    The robot is in its rest pose in the keyframe `start`, whose controls aim at that pose. Nobody balances, so it
    topples. MuJoCo writes six digits of each number.

    Args:
        robot: The robot; its actuators are position servos in the order of its joints.
        obj: The object, at the origin facing +x, with its convex pieces as meshes within the text.
        preset: Which of the robot's gains the servos have.
        visuals: Add what is only there for pictures. What collides is in geom group 3 then, which viewers hide.

    Raises:
        UnknownName: The robot has no such gains.
        BadObject: The object cannot be simulated.
    """
    spec = describe_scene(robot, obj, preset, visuals=visuals)
    rest = np.array(robot.rest_pose, float)
    links = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, rest)
    sole = min(robot.keypoint_pos(f"{side}_sole", *links)[2] for side in ("left", "right"))
    place = np.array([obj.bounds()[1][0] + AWAY, 0.0, CLEARANCE - sole])
    heading = rot.from_yaw(np.array(np.pi))
    root = spec.body(robot.links[0].name)
    root.pos, root.quat = place, heading  # where it is before anybody asks for the keyframe, too
    movable = [0.0, 0.0, 0.0, *rot.IDENTITY] if obj.movable else []
    spec.add_key(name=START, qpos=[*place, *heading, *rest, *movable], ctrl=rest)
    spec.compile()
    return spec.to_xml()
