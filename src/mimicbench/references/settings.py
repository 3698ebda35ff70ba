"""What can be set of human clips, known without what makes them."""

from dataclasses import dataclass

from mimicbench.core.settings import Count

MADE = "made"


@dataclass(frozen=True)
class ReferencesConfig:
    """Which human clips there are."""

    source: str = MADE
    """`made`, or the name of a set that was imported or augmented, objects and all."""
    count: Count = 2000
    """Good clips to have, spread evenly over the objects: what fails the quality gate is replaced by further clips. A
    named set is used whole.
    """
    test_only: bool = False
    """Use the objects of the test split alone: for an evaluation without training."""
    alike: bool = False
    """Everybody does it in one style: the middle of what there is to choose. What is done then follows from start and
    object, and can be learned by who is told no style."""

    @property
    def flags(self) -> dict[str, bool]:
        """What decides which clips are made; `alike` where it is on alone: without it they are as they were."""
        return {"test_only": self.test_only, **({"alike": True} if self.alike else {})}
