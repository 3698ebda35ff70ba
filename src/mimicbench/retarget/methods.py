"""The retargeting methods by name: the paper's three (section 4.1) and our own."""

from collections.abc import Callable
from dataclasses import dataclass

from mimicbench.core.errors import UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.copy_rotation import copy_rotation
from mimicbench.retarget.interaction import interact
from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.optimization import PAPER, OptimizationConfig, optimize
from mimicbench.retarget.shape_alignment import align_and_optimize


@dataclass(frozen=True)
class Method:
    """A way from a human clip to a robot clip."""

    name: str
    title: str
    """As in tables."""
    retarget: Callable[[Clip, Preset], RobotMotion]


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method("copy-rotation", "Copy rotation", copy_rotation),
        Method("optimization", "Optimization", lambda clip, preset: optimize(clip, CONFIGS[preset])),
        # its human has the robot's bones: what `improved` adds to the tables, for bones that differ, has no place in it
        Method("omnih2o", "OmniH2O", lambda clip, preset: align_and_optimize(clip, CONFIGS["paper"])),
        Method("interaction", "Interaction (ours)", lambda clip, _: interact(clip)),
    )
}
CONFIGS: dict[Preset, OptimizationConfig] = {"paper": PAPER, "improved": OptimizationConfig()}


def get_method(name: str) -> Method:
    """A method by name. Raises UnknownName."""
    if name not in METHODS:
        raise UnknownName("retargeting method", name, list(METHODS))
    return METHODS[name]
