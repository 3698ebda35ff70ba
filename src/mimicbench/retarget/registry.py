"""The retargeting methods by name: the paper's three (section 4.1) and our own."""

from collections.abc import Callable
from dataclasses import dataclass

from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.retarget.acceptance import PROMISED, Limits
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.methods.copy_rotation import copy_rotation
from mimicbench.retarget.methods.interaction import interact
from mimicbench.retarget.methods.optimization import PAPER, OptimizationConfig, optimize
from mimicbench.retarget.methods.shape_alignment import align_and_optimize


@dataclass(frozen=True)
class Method:
    """A way from a human clip to a robot clip."""

    name: str
    title: str
    """As in tables."""
    retarget: Callable[[Clip, Preset], RobotMotion]
    presets: tuple[Preset, ...] = ("improved", "paper")
    """Those that it distinguishes, its default first."""
    limits: Limits = Limits()
    """What a clip that it solved measures at most."""

    def preset(self, wanted: Preset | None) -> Preset:
        """The preset that the user wants, or the default.

        Raises MimicbenchError for one that the method does not have.
        """
        if wanted is not None and wanted not in self.presets:
            raise MimicbenchError(f"{self.name} has no preset {wanted!r}, only {self.presets[0]!r}; leave --preset out")
        return wanted or self.presets[0]


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method("copy-rotation", "Copy rotation", copy_rotation),
        # its human has the robot's bones: what `improved` adds to the tables, for bones that differ, has no place in it
        Method("omnih2o", "OmniH2O", lambda clip, _: align_and_optimize(clip, CONFIGS["paper"]), ("paper",)),
        Method("optimization", "Optimization", lambda clip, preset: optimize(clip, CONFIGS[preset])),
        Method("interaction", "Interaction (ours)", lambda clip, _: interact(clip), ("improved",), PROMISED),
    )
}
CONFIGS: dict[Preset, OptimizationConfig] = {"paper": PAPER, "improved": OptimizationConfig()}


def get_method(name: str) -> Method:
    """A method by name. Raises UnknownName."""
    if name not in METHODS:
        raise UnknownName("retargeting method", name, list(METHODS))
    return METHODS[name]
