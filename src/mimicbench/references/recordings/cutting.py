"""Clips as they are cut out of recordings: at one frame rate, bridged where a recording jumps, with labels of what
bears.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import FITTED, SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.references.checks.contacts import BEARING_NAMES, detect_bearing
from mimicbench.references.importers.recording import Recording

FPS = 30.0
"""Frame rate of the clips that are made."""
JUMP, BRIDGE = 12.0, 0.17
"""A joint that turns faster than JUMP [rad/s] is taken for a fault of the recording and bridged over BRIDGE [s] before
and after."""
SLOWDOWN, HELD = 0.3, 1.1
"""The last SLOWDOWN [s] of a reach or a lift are stretched to twice as long, in which it comes to rest; then it is held
for HELD [s]."""

Clip = tuple[HumanMotion, SceneObject]


def each(recording: Recording, parts: Sequence[Any], make: Callable[[Any, int], Clip]) -> list[Clip]:
    """A clip of every part; those to which nothing fits are left out, unless nothing fits to any."""
    clips, last = [], None
    for number, part in enumerate(parts):
        try:
            clips.append(make(part, number))
        except BadMotion as error:
            last = error
    if not clips and last is not None:
        raise last
    return clips


def cut(recording: Recording, start: int, end: int, number: int, task: str) -> HumanMotion:
    """Frames start to end at FPS, where they were recorded."""
    part = slice(start, end)
    local_quat = smooth_jumps(rot.normalize(rot.resample_quat(recording.local_quat[part], recording.fps, FPS)), FPS)
    return HumanMotion(
        f"real-{recording.name}-{number}",
        task,
        recording.skeleton,
        FPS,
        rot.resample(recording.root_pos_w[part], recording.fps, FPS),
        local_quat,
        f"{FITTED}{recording.name}-{number}",
        source=recording.name,
        style={"body_scale": body_of(recording.skeleton).size},
    )


def smooth_jumps(local_quat: np.ndarray, fps: float) -> np.ndarray:
    """Joint rotations (T, J, 4) in which no joint turns faster than JUMP, but in a clip too short for that.

    Where one did, it turns smoothly over BRIDGE on both sides, and over more where that would still be too fast.

    A straight leg has no definite twist, and in real recordings it sometimes jumps by a radian between two frames.
    """
    quat = local_quat.copy()
    reach = max(1, round(BRIDGE * fps))
    speed = np.linalg.norm(rot.to_rotvec(rot.multiply(rot.conjugate(quat[:-1]), quat[1:])), axis=-1) * fps
    for frame, joint in np.argwhere(speed > JUMP):
        first, last = _bridge(quat[:, joint], frame, reach, fps)
        time = np.linspace(0, 1, last - first + 1)
        share = time**2 * (3 - 2 * time)
        ends = np.broadcast_to(quat[[first, last], joint][:, None], (2, len(share), 4))
        quat[first : last + 1, joint] = rot.slerp(ends[0], ends[1], share)
    return quat


def _bridge(quat: np.ndarray, frame: int, reach: int, fps: float) -> tuple[int, int]:
    """First and last frame of a smooth turn of a joint (T, 4) across a jump after `frame`: as near as JUMP allows."""
    width = min(2 * reach - 1, len(quat) - 1)
    while True:
        first = min(max(0, frame + 1 - (width + 1) // 2), len(quat) - 1 - width)
        angle = np.linalg.norm(rot.to_rotvec(rot.multiply(rot.conjugate(quat[first]), quat[first + width])))
        if width == len(quat) - 1 or 1.5 * angle * fps / width <= JUMP:  # a smooth step's steepest part is half steeper
            return first, first + width
        width += 1


def with_contacts(motion: HumanMotion, obj: SceneObject) -> Clip:
    """The clip with labels of what bears in it."""
    return replace(motion, contact_names=BEARING_NAMES, contacts=detect_bearing(motion, obj)), obj


def settled(motion: HumanMotion) -> HumanMotion:
    """The motion, and the object's, with its last part slowed down to a halt, and the last pose held: targets count as
    reached once wrists stay there, and who lifts a box is to hold it.
    """
    slow = min(2 * SLOWDOWN, motion.duration)
    begins = motion.duration - slow / 2
    # in whole frames: by steps of a part of a second the last one before may be where the ending begins, a standstill
    before = np.arange(math.ceil(round(begins * FPS, 6))) / FPS
    time = np.arange(round(slow * FPS)) / FPS
    ending = begins + time - time**2 / (2 * slow)
    frames = FPS * np.concatenate([before, ending, np.full(round(HELD * FPS), motion.duration)])
    of_object = {}
    if len(motion.object_pos_w):
        of_object["object_pos_w"] = _at(motion.object_pos_w, frames)
        of_object["object_quat_w"] = rot.normalize(_quat_at(motion.object_quat_w, frames))
    root, quat = _at(motion.root_pos_w, frames), rot.normalize(_quat_at(motion.local_quat, frames))
    return replace(motion, root_pos_w=root, local_quat=quat, **of_object)


def _at(values: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """(T, 3) values between frames."""
    low = np.minimum(frames.astype(int), len(values) - 2)
    return values[low] + np.minimum(frames - low, 1.0)[:, None] * (values[low + 1] - values[low])


def _quat_at(quat: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """(T, ..., 4) quaternions between frames, along the shortest way."""
    low = np.minimum(frames.astype(int), len(quat) - 2)
    share = np.minimum(frames - low, 1.0).reshape(-1, *[1] * (quat.ndim - 2))
    return rot.slerp(quat[low], quat[low + 1], np.broadcast_to(share, quat[low].shape[:-1]))


def moved(motion: HumanMotion, origin: np.ndarray, yaw: float) -> HumanMotion:
    """The motion seen from a frame on the floor at `origin` (2,) [m] that faces `yaw` [rad]."""
    turn = rot.from_yaw(np.array(-yaw))
    quat = motion.local_quat.copy()
    quat[:, 0] = rot.multiply(turn, quat[:, 0])
    return replace(motion, root_pos_w=rot.rotate(turn, motion.root_pos_w - np.array([*origin, 0.0])), local_quat=quat)
