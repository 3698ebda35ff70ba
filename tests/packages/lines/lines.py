"""A format of recorded people of somebody else: a line of text for each frame, which has seconds, the place of the
pelvis (x, y, z) [m], z up, and the rotation (w, x, y, z) of each of UniHSI's 15 joints in its parent's frame.
"""

from pathlib import Path

import numpy as np

from mimicbench.core.errors import BadMotion
from mimicbench.core.foreign.untrusted import read_bytes
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.importers.format import Format, Glimpse
from mimicbench.references.importers.recording import (
    MAX_BYTES,
    Recording,
    Wishes,
    check_array,
    check_rate,
    check_unit_quat,
    finish,
)

JOINTS = 15


def read(path: Path, wishes: Wishes) -> Recording:
    """Read one recording. Raises BadFile or BadMotion."""
    text = read_bytes(path, MAX_BYTES).decode("utf-8", "replace")
    try:
        table = np.array([[float(number) for number in line.split()] for line in text.splitlines()])
    except ValueError:
        raise BadMotion(
            f"{path} has other things than numbers, or lines of different lengths; write it again"
        ) from None
    table = check_array(path, "the lines", table, (4 + 4 * JOINTS,))
    fps = check_rate(path, (len(table) - 1) / max(table[-1, 0] - table[0, 0], 1e-9), wishes)
    local = check_unit_quat(path, table[:, 4:].reshape(-1, JOINTS, 4), "wxyz")
    assumed = (f"{fps:.3g} frames per second, as its times say", "bones are as long as UniHSI's")
    return finish(path, Recording(path.stem, unihsi_body().skeleton, fps, table[:, 1:4], local, assumed, wishes=wishes))


def recognizes(file: Glimpse) -> bool:
    """By the ending of its name."""
    return not file.content and file.suffix == ".lines"


FORMAT = Format("lines", read, recognizes)
