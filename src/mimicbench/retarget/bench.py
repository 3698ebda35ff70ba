"""How fast retargeting is."""

from collections.abc import Sequence
from time import process_time

from mimicbench.retarget.clip import Clip
from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.methods import Method


def frames_per_second(clips: Sequence[Clip], method: Method, preset: Preset | None = None) -> float:
    """Frames of these clips retargeted per second of processor time, everything included. The first clip is done once more before, unmeasured."""
    used = method.preset(preset)
    method.retarget(clips[0], used)
    start = process_time()
    for clip in clips:
        method.retarget(clip, used)
    return sum(clip.motion.frames for clip in clips) / (process_time() - start)
