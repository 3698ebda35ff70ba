"""A goal is data: what a task has to find in the scene, or is told, as named numbers that lie in a plane.

A goal is a vector of G numbers in some frame on the floor: its fields one after the other. Perception, the memory that
odometry carries along, the noise of training and the words for what was missed follow from the fields; no code that
uses a goal knows what it is the goal of. All functions take tensors (..., G) and broadcast; torch is imported when the
first is called, for who only asks what tasks there are should not wait for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.symmetry import symmetries
from mimicbench.tasks.field import FREE, SIZES, Field

if TYPE_CHECKING:
    import torch
    from torch import Tensor

_ALIKE = 0.01
"""Right answers that differ by less in every number are the same."""


@dataclass(frozen=True)
class GoalSpec:
    """What the goals of a task consist of."""

    fields: tuple[Field, ...]
    describe: Callable[[SceneObject], np.ndarray] | None
    """(G,) the goal in the frame of an object that stands at the origin, facing +x; None if goals are given.

    Raises BadObject if the object has none."""
    window: float = 0.0
    """[m] Side of the part of the map to look at, with room for every object at any angle; 0 if goals are given."""
    near: float = 0.0
    """[m] Who is no farther from the goal's middle is at the object, may have moved it, and does not look any more."""
    stand_ins: Callable[[np.ndarray, np.ndarray], Sequence[SceneObject]] | None = None
    """Objects with a goal (G,) in its own frame, where its middle is the origin and its front is +x, amid what rises
    from the floor there: points (M, 3), x, y and height above the floor [m]. What somebody plans with who knows no more
    than that; with the first, or the next where nothing can be planned with that."""
    taken: Callable[[Tensor], Tensor] | None = None
    """How goals (N, G) that are seen from the origin are best gone about; None: as they are seen."""

    @property
    def given(self) -> bool:
        """Whether the goal is told, such as targets of the wrists, and not seen."""
        return self.describe is None

    @cached_property
    def columns(self) -> dict[str, tuple[int, ...]]:
        """Where each field's numbers are in the vector, by name."""
        found, first = {}, 0
        for field in self.fields:
            found[field.name] = tuple(range(first, first + SIZES[field.kind]))
            first += SIZES[field.kind]
        return found

    @property
    def size(self) -> int:
        """G."""
        return sum(SIZES[field.kind] for field in self.fields)

    @property
    def memory_size(self) -> int:
        """Numbers that are remembered: the goal as it was seen, and where it is by now."""
        return self.size + len(self._moving)

    @cached_property
    def where(self) -> tuple[int, ...]:
        """Columns of the goal's x and y: of its first place or point."""
        return next(self.columns[field.name][:2] for field in self.fields if field.kind in ("place", "point"))

    @cached_property
    def front(self) -> tuple[int, int]:
        """Columns of sine and cosine of where the goal faces: of its first direction."""
        return self._directions[0]

    def place(self, goal: Tensor) -> Tensor:
        """(..., 3) where goals (..., G) are, x, y [m], and where they face [rad]: the first place and direction, or,
        where they have no direction, the middle of their points, facing the origin of their frame.
        """
        if self._directions:
            (x, y), (s, c) = self.where, self._directions[0]
            return rot.stack([goal[..., x], goal[..., y], goal[..., s].atan2(goal[..., c])], -1)
        x, y = rot.stack([goal[..., list(columns[:2])] for columns in self._places]).mean(0).unbind(-1)
        return rot.stack([x, y, (-y).atan2(-x)], -1)

    def middle_and_spread(self) -> tuple[Tensor, Tensor]:
        """(G,) and (G,) of a network's outputs."""
        import torch

        middles = [field.middle for field in self.fields for _ in range(SIZES[field.kind])]
        spreads = [field.spread for field in self.fields for _ in range(SIZES[field.kind])]
        return torch.tensor(middles), torch.tensor(spreads)

    def label(self, obj: SceneObject) -> np.ndarray:
        """(A, G) all right answers for an object: more than one where it looks alike from several sides.

        Raises BadObject if the object has no such goal.
        """
        import torch

        if self.describe is None:
            raise ValueError("a given goal is not read off an object")
        goal = torch.from_numpy(self.describe(obj))
        found: list[np.ndarray] = []
        for matrix in symmetries(obj):
            answer = self.transformed(goal, matrix).numpy()
            if not any(np.abs(answer - other).max() < _ALIKE for other in found):
                found.append(answer)
        return np.array(found)

    def labels(self, objects: Sequence[SceneObject]) -> Tensor:
        """(N, A, G) of several objects, each answer repeated where others have more."""
        import torch

        each = [self.label(obj) for obj in objects]
        most = max(map(len, each))
        return torch.tensor(np.array([answers[np.arange(most) % len(answers)] for answers in each])).float()

    def facing(self, answers: Tensor) -> Tensor:
        """(N, A, G) right answers in heading frames, each whose front (the first direction) is turned away from the
        robot replaced by the one that faces it most: clips start in front of their objects.
        """
        import torch

        if not self._directions:
            return answers
        (x, y), (s, c) = self.where, self._directions[0]
        length = answers[..., (x, y)].norm(dim=-1).clamp(min=1e-6)
        front = -(answers[..., c] * answers[..., x] + answers[..., s] * answers[..., y]) / length
        most = answers[torch.arange(len(answers), device=answers.device), front.argmax(-1)]
        return torch.where((front > 0)[..., None], answers, most[:, None])

    def told(self, wrist_goal_w: Tensor) -> Tensor:
        """(..., G) given goals, from places of the wrists (..., 2, 3) [m]."""
        return wrist_goal_w.flatten(-2)

    def to_root(self, goal: Tensor, root_pos: Tensor, root_yaw: Tensor) -> Tensor:
        """Goals (..., G) in the heading frame of a root at (..., 2+) [m] that faces `root_yaw` (...) [rad]."""
        cos, sin = root_yaw.cos(), root_yaw.sin()
        columns = list(goal.unbind(-1))
        for x, y in self._places:
            dx, dy = columns[x] - root_pos[..., 0], columns[y] - root_pos[..., 1]
            columns[x], columns[y] = cos * dx + sin * dy, cos * dy - sin * dx
        for s, c in self._directions:
            columns[s], columns[c] = columns[s] * cos - columns[c] * sin, columns[c] * cos + columns[s] * sin
        return _broadcast(columns)

    def from_root(self, goal: Tensor, root_pos: Tensor, root_yaw: Tensor) -> Tensor:
        """The inverse of `to_root`."""
        cos, sin = root_yaw.cos(), root_yaw.sin()
        columns = list(goal.unbind(-1))
        for x, y in self._places:
            columns[x], columns[y] = (
                root_pos[..., 0] + cos * columns[x] - sin * columns[y],
                root_pos[..., 1] + sin * columns[x] + cos * columns[y],
            )
        for s, c in self._directions:
            columns[s], columns[c] = columns[s] * cos + columns[c] * sin, columns[c] * cos - columns[s] * sin
        return _broadcast(columns)

    def carried(self, goal: Tensor, odometry_pos: Tensor, odometry_yaw: Tensor) -> Tensor:
        """What is remembered (..., memory_size): the goal as seen at the start, and what moves of it as it is by now.

        Args:
            goal: (..., G) in the heading frame of the start.
            odometry_pos: (..., 2) the root's position in the heading frame of the start, by its own reckoning [m].
            odometry_yaw: (...) its heading since then [rad].
        """
        return self.joined(goal, self.to_root(goal, odometry_pos, odometry_yaw))

    def joined(self, goal: Tensor, now: Tensor) -> Tensor:
        """What is remembered (..., memory_size), of goals (..., G) in the heading frame of the start, and of now."""
        import torch

        return torch.cat([goal, now[..., self._moving]], -1)

    def now(self, memory: Tensor) -> Tensor:
        """(..., G) the goal as it is by now, of what `carried` gave."""
        goal = memory[..., : self.size].clone()
        goal[..., self._moving] = memory[..., self.size :]
        return goal

    def normalized(self, goal: Tensor) -> Tensor:
        """Goals (..., G) whose sines and cosines are scaled to directions."""
        columns = list(goal.unbind(-1))
        for s, c in self._directions:
            length = rot.stack([columns[s], columns[c]], -1).norm(dim=-1).clamp(min=1e-6)
            columns[s], columns[c] = columns[s] / length, columns[c] / length
        return rot.stack(columns, -1)

    def transformed(self, goal: Tensor, matrix: np.ndarray) -> Tensor:
        """Goals (..., G) turned or mirrored about the origin by an orthogonal matrix (2, 2)."""
        (a, b), (c, d) = matrix.tolist()
        columns = list(goal.unbind(-1))
        for x, y in (*self._places, *((cos, sin) for sin, cos in self._directions)):
            columns[x], columns[y] = a * columns[x] + b * columns[y], c * columns[x] + d * columns[y]
        return rot.stack(columns, -1)

    def shifted(self, goal: Tensor, by: Tensor) -> Tensor:
        """Goals (..., G) moved by (..., 2) [m]."""
        columns = list(goal.unbind(-1))
        for x, y in self._places:
            columns[x], columns[y] = columns[x] + by[..., 0], columns[y] + by[..., 1]
        return rot.stack(columns, -1)

    def disturbed(self, goal: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Goals (N, G) with errors as perception makes them."""
        import torch

        free = sum(FREE[field.kind] for field in self.fields)
        noise = list(torch.randn(len(goal), free, generator=generator, device=goal.device, dtype=goal.dtype).unbind(-1))
        columns = list(goal.unbind(-1))
        for field in self.fields:
            where = self.columns[field.name]
            if field.kind == "direction":
                s, c = where
                turn = field.noise * noise.pop(0)
                columns[s], columns[c] = (
                    columns[s] * turn.cos() + columns[c] * turn.sin(),
                    columns[c] * turn.cos() - columns[s] * turn.sin(),
                )
                continue
            for column in where:
                columns[column] = columns[column] + field.noise * noise.pop(0)
        return rot.stack(columns, -1)

    def nearest(self, goal: Tensor, answers: Tensor) -> Tensor:
        """(N, ..., G) the right answer (N, A, G) that is most like each goal (N, ..., G), weighed by spread."""
        import torch

        _, spread = self.middle_and_spread()
        each = goal.flatten(1, -2) if goal.ndim > 2 else goal[:, None]
        unlike = (((each[:, :, None] - answers[:, None]) / spread.to(goal)) ** 2).sum(-1)
        chosen = answers[torch.arange(len(goal), device=goal.device)[:, None], unlike.argmin(-1)]
        return chosen.reshape(goal.shape)

    def errors(self, goal: Tensor, truth: Tensor) -> dict[str, Tensor]:
        """How far off goals (..., G) are, by name of the field: (...) distances [m], angles [rad] of directions."""
        import torch

        found = {}
        for field in self.fields:
            seen, right = goal[..., self.columns[field.name]], truth[..., self.columns[field.name]]
            if field.kind == "direction":
                found[field.name] = torch.atan2(
                    seen[..., 0] * right[..., 1] - seen[..., 1] * right[..., 0],
                    seen[..., 0] * right[..., 0] + seen[..., 1] * right[..., 1],
                ).abs()
            else:
                found[field.name] = (seen - right).norm(dim=-1)
        return found

    def in_words(self, goal: Tensor, truth: Tensor) -> str:
        """How far off one goal (G,) is, such as `middle 12 cm off, front 20 degrees off`; what is right is left out."""
        import torch

        kinds = {field.name: field.kind for field in self.fields}
        told = []
        for name, error in self.errors(goal, truth).items():
            amount, unit = (torch.rad2deg(error), "degrees") if kinds[name] == "direction" else (100 * error, "cm")
            if round(float(amount)):
                told.append(f"{name} {float(amount):.0f} {unit} off")
        return ", ".join(told) or "right"

    @cached_property
    def _places(self) -> tuple[tuple[int, int], ...]:
        """Columns x and y of everything that has a place."""
        return self._pairs("place", "point")

    @cached_property
    def _directions(self) -> tuple[tuple[int, int], ...]:
        """Columns of sine and cosine of all directions."""
        return self._pairs("direction")

    def _pairs(self, *kinds: str) -> tuple[tuple[int, int], ...]:
        """The first two columns of all fields of such kinds."""
        found = (self.columns[field.name] for field in self.fields if field.kind in kinds)
        return tuple((columns[0], columns[1]) for columns in found)

    @cached_property
    def _moving(self) -> list[int]:
        """Columns of all but the scalars."""
        return [column for field in self.fields if field.kind != "scalar" for column in self.columns[field.name]]


def _broadcast(columns: Sequence[Tensor]) -> Tensor:
    """Columns of shapes that broadcast, side by side along a new last axis."""
    import torch

    return torch.stack(torch.broadcast_tensors(*columns), -1)
