"""What can be set of retargeting, known without what does it."""

from dataclasses import dataclass

from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.registry import DEFAULT_METHOD


@dataclass(frozen=True)
class RetargetConfig:
    """How to retarget."""

    method: str = DEFAULT_METHOD
    """One of `mimicbench.retarget.registry.METHODS`."""
    variant: Preset | None = None
    """`paper`: tables and loss to the letter; `improved`: what we find to be better; None: the method's default."""
