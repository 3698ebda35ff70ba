"""How fast retargeting is."""

from collections.abc import Sequence
from time import perf_counter

from mimicbench.retarget.clip import Clip
from mimicbench.retarget.methods import Method


def frames_per_second(clips: Sequence[Clip], method: Method) -> float:
    """Frames of these clips retargeted per second by this process, everything included. The first clip is done once more before, unmeasured."""
    method.retarget(clips[0], "improved")
    start = perf_counter()
    for clip in clips:
        method.retarget(clip, "improved")
    return sum(clip.motion.frames for clip in clips) / (perf_counter() - start)
