"""How fast retargeting is."""

from collections.abc import Sequence
from time import perf_counter

from mimicbench.core.motion import HumanMotion
from mimicbench.retarget.optimization import OptimizationConfig, retarget_clip
from mimicbench.robot.description import Robot


def frames_per_second(motions: Sequence[HumanMotion], robot: Robot, config: OptimizationConfig | None = None) -> float:
    """Frames of these clips retargeted per second by this process, everything included. The first clip is done once more before, unmeasured."""
    retarget_clip(motions[0], robot, config)
    start = perf_counter()
    for motion in motions:
        retarget_clip(motion, robot, config)
    return sum(motion.frames for motion in motions) / (perf_counter() - start)
