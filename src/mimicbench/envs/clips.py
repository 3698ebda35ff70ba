"""A set of retargeted clips with the objects that they are beside: what trackers, learners and judges are given."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.objects.shape import SceneObject, original_of
from mimicbench.robots.description import Robot
from mimicbench.tasks.task import Task


@dataclass(frozen=True)
class ClipSet:
    """Clips of one task on one robot."""

    task: Task
    robot: Robot
    motions: Sequence[RobotMotion]
    objects: Mapping[str, SceneObject]
    """By id, at least those of the motions."""

    def __post_init__(self) -> None:
        missing = sorted({motion.object_id for motion in self.motions} - set(self.objects))
        if missing:
            raise MimicbenchError(f"object {missing[0]!r} of the clips is missing; make the objects and clips again")

    def __len__(self) -> int:
        return len(self.motions)

    @property
    def scenes(self) -> list[SceneObject]:
        """The object of each clip."""
        return [self.objects[motion.object_id] for motion in self.motions]

    def split(self, name: str | None) -> "ClipSet":
        """The clips on objects of one split, `train` or `test`; all if None."""
        if name is None:
            return self
        kept = [motion for motion in self.motions if self.objects[motion.object_id].split == name]
        return replace(self, motions=kept)

    def joined(self, other: "ClipSet") -> "ClipSet":
        """These clips and others of the same task on the same robot.

        Raises MimicbenchError if they call two objects by one name.
        """
        for name, obj in other.objects.items():
            mine = self.objects.get(name, obj)
            if mine is not obj and mine.to_dict() != obj.to_dict():
                raise MimicbenchError(
                    f"two objects are called {name!r}, as where files of one name were imported into two sets; rename "
                    "a file and import it again"
                )
        return replace(self, motions=[*self.motions, *other.motions], objects={**self.objects, **other.objects})

    def first(self, count: int) -> "ClipSet":
        """The first so many clips."""
        return replace(self, motions=self.motions[:count])

    def batches(self, size: int) -> "list[ClipSet]":
        """All clips in their order, so many at a time."""
        starts = range(0, len(self.motions), size)
        return [replace(self, motions=self.motions[start : start + size]) for start in starts]

    def spread(self, count: int) -> "ClipSet":
        """About so many clips from all over the set, never more."""
        have = len(self.motions)
        return replace(
            self, motions=[self.motions[i * have // count] for i in range(count)] if have > count else self.motions
        )


def learned_and_judged(parts: Mapping[str, ClipSet]) -> tuple[list[ClipSet], list[ClipSet]]:
    """For each task, clips to learn from and clips that only judge, of sets by `task`, or `task/set` for recordings.

    Recordings are learned from whole, whatever their objects are called: who imports them has split them, by person,
    and what is only to judge is in another set. Of variants of clips that only judge nothing is learned.
    """
    learned: dict[str, ClipSet] = {}
    judged: dict[str, ClipSet] = {}
    for name, clips in parts.items():
        task, _, recorded = name.partition("/")
        if recorded:
            apart = {original_of(motion.object_id) for motion in judged[task].motions}
            others = [motion for motion in clips.motions if original_of(motion.object_id) not in apart]
            learned[task] = learned[task].joined(replace(clips, motions=others))
        else:
            learned[task], judged[task] = clips.split("train"), clips.split("test")
    return list(learned.values()), list(judged.values())
