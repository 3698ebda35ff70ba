"""`mimicbench export scene`, `export motion`: for other people's programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.commands.options import Json
from mimicbench.commands.telling import tell
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS

RobotName = Annotated[str, tyro.conf.arg(name="robot", help=f"which robot: {', '.join(ROBOTS)}")]


def scene(
    thing: Annotated[
        str,
        tyro.conf.Positional,
        tyro.conf.arg(
            metavar="OBJECT", help="id of an object that is made, such as chair-0-00042, or an object's file"
        ),
    ],
    out: Annotated[Path | None, tyro.conf.arg(help="the MJCF to write; by default <robot>-<object>.xml here")] = None,
    robot: RobotName = DEFAULT_ROBOT,
    gains: Annotated[str, tyro.conf.arg(help="which of the robot's gains the servos have")] = "improved",
    look: Annotated[
        Literal["shells", "shapes"], tyro.conf.arg(help="show the robot's shells, or only what collides")
    ] = "shells",
    as_json: Json = False,
) -> None:
    """Write a robot before an object as MJCF: `python -m mujoco.viewer --mjcf=FILE` opens it."""
    from mimicbench.core.files import write_atomic
    from mimicbench.objects.make import find_object
    from mimicbench.sim.mjcf import scene_xml

    obj = find_object(thing)
    path = out or Path(f"{robot}-{obj.id}.xml")
    text = scene_xml(ROBOTS.get(robot), obj, gains, look == "shells")
    write_atomic(path, lambda stream: stream.write(text.encode()))
    told = {"file": str(path), "robot": robot, "object": obj.id, "bytes": len(text)}
    tell([told], as_json, f"{path}: {robot} before {obj.id}")


def motion(
    clip: Annotated[
        Path,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="CLIP", help="a retargeted clip: <workdir>/<task>/retarget/<name>/<id>.npz"),
    ],
    out: Annotated[Path | None, tyro.conf.arg(help="the .npz to write; by default <id>-tracking.npz here")] = None,
    as_json: Json = False,
) -> None:
    """Write a robot clip as the .npz that BeyondMimic and mjlab track: joints and bodies at 50 Hz."""
    from mimicbench.core.motion import RobotMotion
    from mimicbench.envs.tracking_file import write_tracking_file

    found = RobotMotion.load(clip)
    path = out or Path(f"{found.id}-tracking.npz")
    arrays = write_tracking_file(path, found, ROBOTS.get(found.robot))
    frames, bodies = arrays["body_pos_w"].shape[:2]
    told = {"file": str(path), "robot": found.robot, "frames": frames, "bodies": bodies, "fps": int(arrays["fps"][0])}
    tell([told], as_json, f"{path}: {frames} frames of {found.robot}, {bodies} bodies")
