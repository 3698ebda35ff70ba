"""Clips of the tasks, cut out of recordings of real people, each beside an object: the recorded one, or one fitted to the person."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.contacts import CONTACT_NAMES, detect_contacts
from mimicbench.references.fit_object import fit_chair, seated_frame
from mimicbench.references.recording import Recording
from mimicbench.references.segments import Sitting, SittingRules, find_sittings
from mimicbench.references.unihsi import import_skeleton_motion

FPS = 30.0
"""Frame rate of the clips that are made."""
JUMP, BRIDGE = 12.0, 0.17
"""A joint that turns faster than JUMP [rad/s] is taken for a fault of the recording and bridged over BRIDGE [s] before and after."""


def import_sitting(path: Path, rules: SittingRules | None = None) -> list[tuple[HumanMotion, SceneObject]]:
    """Every part of a recording in which somebody walks up and sits down, each with a chair fitted under the person.

    Ids are `real-<file>-<n>` and `fitted-<file>-<n>`. Raises BadFile, or BadMotion if the file is not such a recording.
    """
    recording = import_skeleton_motion(path)
    pos, _ = recording.forward_kinematics()
    sittings = find_sittings(recording.skeleton, pos, recording.fps, rules)
    if not sittings:
        lowest, highest = pos[:, 0, 2].min(), pos[:, 0, 2].max()
        raise BadMotion(
            f"{path} has no part in which somebody walks up and sits down (the pelvis is between {lowest:.2f} and {highest:.2f} m high); leave it out"
        )
    return [_sitting_clip(recording, sitting, number) for number, sitting in enumerate(sittings)]


def _sitting_clip(recording: Recording, sitting: Sitting, number: int) -> tuple[HumanMotion, SceneObject]:
    """One walk-to-seated part, moved to where its chair is at the origin facing +x, at FPS."""
    part = slice(sitting.start, sitting.end)
    local_quat = smooth_jumps(rot.normalize(rot.resample_quat(recording.local_quat[part], recording.fps, FPS)), FPS)
    motion = HumanMotion(
        f"real-{recording.name}-{number}", "sit-chair", recording.skeleton, FPS,
        rot.resample(recording.root_pos_w[part], recording.fps, FPS), local_quat,
        f"fitted-{recording.name}-{number}", source=recording.name, style={"body_scale": 1.0},
    )  # fmt: skip
    landing = min(motion.frames - 2, round((sitting.landing - sitting.start) * FPS / recording.fps))
    seated = slice(landing, motion.frames)
    origin, yaw, _ = seated_frame(motion, seated)
    motion = _moved(motion, origin, yaw)
    fit = fit_chair(motion.object_id, motion, seated)
    motion = _moved(motion, fit.offset, 0.0)
    motion = replace(motion, contact_names=CONTACT_NAMES, contacts=detect_contacts(motion, fit.obj))
    return motion, fit.obj


def smooth_jumps(local_quat: np.ndarray, fps: float) -> np.ndarray:
    """Joint rotations (T, J, 4) in which no joint turns faster than JUMP; where one did, it turns smoothly over BRIDGE on both sides.

    A straight leg has no definite twist, and in real recordings it sometimes jumps by a radian between two frames.
    """
    quat = local_quat.copy()
    reach = max(1, round(BRIDGE * fps))
    speed = np.linalg.norm(rot.to_rotvec(rot.multiply(rot.conjugate(quat[:-1]), quat[1:])), axis=-1) * fps
    for frame, joint in np.argwhere(speed > JUMP):
        first, last = max(0, frame + 1 - reach), min(len(quat) - 1, frame + reach)
        time = np.linspace(0, 1, last - first + 1)
        share = time**2 * (3 - 2 * time)
        ends = np.broadcast_to(quat[[first, last], joint][:, None], (2, len(share), 4))
        quat[first : last + 1, joint] = rot.slerp(ends[0], ends[1], share)
    return quat


def _moved(motion: HumanMotion, origin: np.ndarray, yaw: float) -> HumanMotion:
    """The motion seen from a frame on the floor at `origin` (2,) [m] that faces `yaw` [rad]."""
    turn = rot.from_yaw(np.array(-yaw))
    quat = motion.local_quat.copy()
    quat[:, 0] = rot.multiply(turn, quat[:, 0])
    return replace(motion, root_pos_w=rot.rotate(turn, motion.root_pos_w - np.array([*origin, 0.0])), local_quat=quat)
