"""What motions of any kind have in common: the checks that every clip passes, and how object and goal are stored.

See docs/formats.md.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.errors import BadMotion

SCHEMA = 1
MAX_FRAMES = 200_000  # more than an hour at 50 fps: nothing we read is longer


def check_frames(clip: str, fps: float, arrays: dict[str, tuple[np.ndarray, tuple[int, ...]]]) -> None:
    """Refuse a clip whose rate, length, shapes or numbers are not those of a motion."""
    if not (np.isfinite(fps) and 1 <= fps <= 1000):
        raise BadMotion(f"clip {clip}: {fps} frames per second is not a frame rate; give one between 1 and 1000")
    frames = len(next(iter(arrays.values()))[0])
    if not 2 <= frames <= MAX_FRAMES:
        raise BadMotion(f"clip {clip} has {frames} frames; a motion needs between 2 and {MAX_FRAMES}")
    for name, (array, shape) in arrays.items():
        if array.shape != (frames, *shape):
            raise BadMotion(f"clip {clip}: {name} has shape {array.shape}, expected {(frames, *shape)}")
        if not np.isfinite(array).all():
            raise BadMotion(f"clip {clip}: {name} holds NaN or infinity; mend or drop the clip")


def check_unit(clip: str, name: str, quat: np.ndarray) -> None:
    """Refuse quaternions (..., 4) that are not of unit length."""
    worst = np.abs((quat**2).sum(-1) - 1).max()
    if worst > 1e-2:
        raise BadMotion(
            f"clip {clip}: {name} is not of unit length (off by {worst:.2g}); are these quaternions in the order wxyz?"
        )


def check_contacts(clip: str, frames: int, names: tuple[str, ...], contacts: np.ndarray) -> None:
    """Refuse contact labels that do not fit their names."""
    if names and contacts.shape != (frames, len(names)):
        raise BadMotion(f"clip {clip}: contacts has shape {contacts.shape}, expected {(frames, len(names))}")


def check_scene(
    clip: str, frames: int, object_pos: np.ndarray, object_quat: np.ndarray, wrist_goal: np.ndarray
) -> None:
    """Refuse an object pose or a wrist goal that does not fit the clip."""
    if len(object_pos) or len(object_quat):
        check_frames(
            clip,
            1.0,
            {
                "root_pos_w": (np.zeros((frames, 0)), (0,)),
                "object_pos_w": (object_pos, (3,)),
                "object_quat_w": (object_quat, (4,)),
            },
        )
        check_unit(clip, "object_quat_w", object_quat)
    known = np.isfinite(wrist_goal).all(-1)
    if wrist_goal.shape not in ((0, 3), (2, 3)) or not (known | np.isnan(wrist_goal).all(-1)).all():
        raise BadMotion(
            f"clip {clip}: wrist_goal_w must be two places of three finite numbers, left and right, or none; three NaN "
            "for a hand without a goal"
        )
    if len(wrist_goal) and not known.any():
        raise BadMotion(f"clip {clip}: wrist_goal_w has no place for either hand; leave it empty")


_SCENE = ("object_pos_w", "object_quat_w", "wrist_goal_w")


def scene_arrays(object_pos: np.ndarray, object_quat: np.ndarray, wrist_goal: np.ndarray) -> dict[str, np.ndarray]:
    """What a clip says of its object and goal, if anything, as it is stored."""
    given = zip(_SCENE, (object_pos, object_quat, wrist_goal), strict=True)
    return {name: array.astype(np.float32) for name, array in given if len(array)}


def read_scene(data: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The inverse of `scene_arrays`."""
    arrays = {name: data[name].astype(float) for name in _SCENE if name in data}
    if "object_quat_w" in arrays:
        arrays["object_quat_w"] = read_quat(arrays["object_quat_w"])
    return arrays


def check_conventions(path: Path, header: dict) -> None:
    """Refuse a file of other conventions than ours."""
    order = header.get("quaternion_order")
    if order != "wxyz":
        raise BadMotion(
            f"{path} does not say that its quaternions are wxyz (it says {order!r}); convert it and "
            "set quaternion_order"
        )
    if header.get("schema") != SCHEMA:
        raise BadMotion(f"{path} has schema {header.get('schema')!r}, this version reads {SCHEMA}; make it again")


@contextmanager
def documented(path: Path) -> Iterator[None]:
    """Turn what goes wrong while reading a file of other content than documented into one sentence."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadMotion(
            f"{path} is not a motion as docs/formats.md describes it ({error!r}); make it again or convert it"
        ) from None


def read_id(header: dict[str, Any], field: str) -> str:
    """An id of a file's header, which becomes the name of others. Raises ValueError if it would lead elsewhere."""
    found = header[field]
    if not isinstance(found, str) or re.search(r"[/\\\0]|^\.", found):
        raise ValueError(f"its {field} is {found!r}, which cannot be a file's name")
    return found


def read_quat(stored: np.ndarray) -> np.ndarray:
    """Stored quaternions in double precision, of unit length if they nearly were.

    What is farther off stays, to be refused.
    """
    quat = stored.astype(float)
    length = np.sqrt((quat**2).sum(-1, keepdims=True))
    return np.where(abs(length - 1) < 5e-3, quat / np.where(length > 0, length, 1.0), quat)
