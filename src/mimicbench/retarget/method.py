"""What a retargeting method is: a way from a human clip to a robot clip, and what its clips measure at most."""

from collections.abc import Callable
from dataclasses import dataclass

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.retarget.acceptance import Limits
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.mapping import Preset


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

    def titled(self, preset: Preset) -> str:
        """Its title, with the preset where it distinguishes several."""
        return f"{self.title} ({preset})" if len(self.presets) > 1 else self.title

    def preset(self, wanted: Preset | None) -> Preset:
        """The preset that the user wants, or the default.

        Raises MimicbenchError for one that the method does not have.
        """
        if wanted is not None and wanted not in self.presets:
            raise MimicbenchError(
                f"{self.name} has no variant {wanted!r}, only {self.presets[0]!r}; leave --variant out"
            )
        return wanted or self.presets[0]
