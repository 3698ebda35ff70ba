"""Imports people who move objects as InterMimic stores them, mostly of OMOMO (`.pt`, 591 numbers per frame, z up, 30
fps).
"""

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.foreign.untrusted import load_torch
from mimicbench.references.body.body import core4d_body
from mimicbench.references.body.skeletons import CORE4D
from mimicbench.references.importers.format import Format, Glimpse
from mimicbench.references.importers.recording import (
    MAX_BYTES,
    ObjectTrack,
    Recording,
    Wishes,
    check_array,
    check_rate,
    check_unit_quat,
    finish,
)
from mimicbench.references.importers.rest_pose import adopt, axis_up, hanging_turns, into_our_rest

FPS = 30.0
WIDTH, BODIES = 591, 52
ROOT, ROOT_QUAT, BODY_POS, OBJECT_POS, OBJECT_QUAT, BODY_QUAT = (
    slice(0, 3),
    slice(3, 7),
    slice(162, 318),
    slice(318, 321),
    slice(321, 325),
    slice(383, 591),
)
"""Columns; quaternions are xyzw."""
SOURCES = (0, 1, 5, 9, 2, 6, 10, 3, 7, 11, 4, 8, 12, 14, 33, 13, 15, 34, 16, 35, 17, 36)
"""Where CORE4D's joints are among the 52 bodies (pelvis, left leg, right leg, spine, left arm with fingers, right arm
with fingers)."""
SLACK = 0.02
"""[m] by which bodies may be off from bones of constant length."""


def import_intermimic(path: Path, wishes: Wishes) -> Recording:
    """Read one motion with its object's track. Raises BadFile or BadMotion."""
    table = load_torch(path, MAX_BYTES)
    if not isinstance(table, np.ndarray) or table.ndim != 2 or table.shape[1] != WIDTH:
        found = f"a tensor of shape {table.shape}" if isinstance(table, np.ndarray) else type(table).__name__
        raise BadMotion(f"{path} holds {found}, expected {WIDTH} numbers per frame as InterMimic has them")
    table = check_array(path, "the motion", table, (WIDTH,))
    fps = check_rate(path, FPS, wishes)
    up, turn = axis_up(wishes.up or "z+")
    assumed = [
        f"{wishes.up or 'z+'} is "
        f"up{', as told' if wishes.up else ', and lengths are in meters, as in all of InterMimic'}",
        f"{fps:g} frames per second, as {'told' if wishes.fps else 'in all of InterMimic'}",
    ]
    pos = rot.rotate(turn, table[:, BODY_POS].reshape(-1, BODIES, 3))
    own = check_unit_quat(path, table[:, BODY_QUAT].reshape(-1, BODIES, 4))
    if np.abs(table[:, ROOT] - table[:, BODY_POS][:, :3]).max() > SLACK:
        raise BadMotion(f"{path}: root and pelvis are not at the same place; it is damaged or in another layout")
    body = core4d_body()
    adopted = adopt(CORE4D, SOURCES, pos, rot.multiply(turn, own))
    if adopted.residual > SLACK:
        raise BadMotion(
            f"{path}: its bodies and its rotations disagree by {adopted.residual:.2g} m; it is "
            "damaged or in another layout"
        )
    try:
        turns = hanging_turns(body, adopted.offsets, np.tile(rot.IDENTITY, (22, 1)), up)
    except BadMotion as error:
        raise BadMotion(f"{path}: {error}; it is damaged or in another layout") from None
    skeleton, local = into_our_rest(body, adopted, turns)
    track = ObjectTrack(
        rot.rotate(turn, table[:, OBJECT_POS]), rot.multiply(turn, check_unit_quat(path, table[:, OBJECT_QUAT]))
    )
    return finish(path, Recording(path.stem, skeleton, fps, adopted.pos, local, tuple(assumed), track, wishes))


def _recognizes(file: Glimpse) -> bool:
    if file.content == "zip":
        return any(name.endswith("data.pkl") for name in file.names)
    return not file.content and file.suffix in (".pt", ".pth")


FORMAT = Format("intermimic", import_intermimic, _recognizes, heeds=("mesh",))
