"""What can be set of demonstrations."""

from dataclasses import dataclass
from typing import Annotated

from mimicbench.core.settings import BadSetting, Later, Positive, Share
from mimicbench.objects.make import MADE

TRACKER, CLIPS, RULE, POSES = "tracker", "clips", "rule", "poses"
"""The expert that follows clips; where demonstrations start."""


@dataclass(frozen=True)
class DemosConfig:
    """How demonstrations are made."""

    source: str = MADE
    """`made`: by the tracker. Else the name of a data set in `<workdir>/<task>/demos`, such as the published one of
    examples/sample; nothing is made then, and all other settings of this stage are without effect."""
    expert: str = TRACKER
    """Who demonstrates, and says in DAgger what should be done: the `tracker` on its clips; or a policy from the clips'
    first frames on, by the name of what is shipped for the task, or the folder of its checkpoint. A tracker knows what
    comes next, and who learns from it has to guess that; a policy acts on nothing that cannot be seen."""
    starts: str = CLIPS
    """Where a policy that demonstrates begins: `clips`, in their first frames; `rule`, at rest around training objects,
    drawn by the rule of the environments: for that no clip has to be made, so there can be thousands; `poses`, there
    as well, but in the poses in which clips begin. People stand straighter than a robot at rest, evaluations begin like
    people, and who learned only from the other way to stand squats and tips over before the first step."""
    clips: Positive = 1500
    """Training clips to track, or to begin from, at most; how many starts are drawn by rule, or in poses."""
    action_noise: float = 0.05
    """Standard deviation of what is added to the executed joint targets [rad]; the recorded targets stay clean."""
    push: float = 0.1
    """Standard deviation of the horizontal velocity that a push adds [m/s], every two seconds in the mean."""
    clean_share: Share = 0.25
    """Part of the clips that are tracked without noise and pushes."""
    batch: Positive = 64
    """Clips side by side: one shard of the data set, and what a kill can lose."""
    images: Annotated[bool, Later()] = False
    """Store the elevation map of every frame, too, as a picture that LeRobot's policies see; our own learners make
    their maps from the states. Some milliseconds and 2 kB a frame."""

    def __post_init__(self) -> None:
        if self.starts not in (CLIPS, RULE, POSES):
            raise BadSetting(f"demos.starts is {self.starts!r}; give clips, rule or poses")
        if self.starts != CLIPS and self.expert == TRACKER:
            raise BadSetting(
                f"demos.starts is {self.starts!r}, where there is no clip for a tracker; name a policy, demos.expert"
            )
