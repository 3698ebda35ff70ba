"""A tracker ready to run, and how what its network takes is laid out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import torch
from torch import Tensor

from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import TERMS, Term, chosen_terms
from mimicbench.tasks.task import Task
from mimicbench.track.network import Blueprint, NetworkConfig, TrackerNetwork
from mimicbench.track.spec import Terms, TrackerSpec


@dataclass(frozen=True)
class Layout:
    """How a network's input is laid out: frames one after the other, and in each of them, terms."""

    names: tuple[str, ...]
    widths: tuple[int, ...]
    """Numbers in each term, of one robot."""
    frames: int = 1
    """F, the present frame and those before it."""
    scales: tuple[float, ...] = ()
    """What each term is multiplied by; empty: nothing is."""

    @staticmethod
    def of(spec: TrackerSpec, robot: Robot, tasks: Sequence[Task], frames: int = 0) -> "Layout":
        """The terms of a tracker that any of the tasks has; in so many frames, 0: as many as its design says."""
        found = {term.name: (term, task) for task in tasks for term in chosen_terms(spec.observations, task)}
        every = [term.name if isinstance(term, Term) else term for term in spec.observations]
        names = tuple(name for name in every if name in found)
        shapes = [term.shape(robot, task) for term, task in (found[name] for name in names)]
        return Layout.known(spec, names, tuple(math.prod(shape) for shape in shapes), frames or spec.frames)

    @staticmethod
    def known(spec: TrackerSpec, names: tuple[str, ...], widths: tuple[int, ...], frames: int) -> "Layout":
        """Of terms of a tracker whose widths are known."""
        scales = tuple(spec.scales.get(name, 1.0) for name in names) if spec.scales else ()
        return Layout(names, widths, frames, scales)

    @property
    def size(self) -> int:
        """O, numbers in one frame."""
        return sum(self.widths)

    def blueprint(self, network: NetworkConfig) -> Blueprint:
        """Of networks that take it."""
        return Blueprint(network, self.size, self.frames)

    def columns_of(self, other: "Layout") -> list[tuple[slice, slice]]:
        """Where each term that both have is in `other`, and where it is here, in each of the last frames of both."""
        theirs, ours = (dict(zip(each.names, each.slices(), strict=True)) for each in (other, self))
        pairs = [(theirs[name], ours[name]) for name in theirs if name in ours]
        return [
            (other.in_frame(there, back), self.in_frame(here, back))
            for back in range(1, 1 + min(other.frames, self.frames))
            for there, here in pairs
        ]

    def in_frame(self, place: slice, back: int) -> slice:
        """Where a place of a frame is in all of them, in the `back`-th from the end."""
        first = (self.frames - back) * self.size
        return slice(place.start + first, place.stop + first)

    def slices(self) -> list[slice]:
        """Where each term is in a frame."""
        ends = list(accumulate(self.widths))
        return [slice(end - width, end) for end, width in zip(ends, self.widths, strict=True)]

    def flat(self, terms: Terms) -> Tensor:
        """(N, O) the present frame; zeros for terms that the robots' task does not have."""
        some = next(iter(terms[name] for name in self.names if name in terms))
        parts = [
            terms[name].flatten(1) if name in terms else some.new_zeros(len(some), width)
            for name, width in zip(self.names, self.widths, strict=True)
        ]
        if self.scales:
            parts = [part * scale for part, scale in zip(parts, self.scales, strict=True)]
        return torch.cat(parts, -1)


@dataclass(frozen=True)
class Tracker:
    """A tracker ready to run, at any task whose terms its network knows."""

    spec: TrackerSpec
    settings: Any
    network: TrackerNetwork
    layout: Layout
    """What its network takes."""
    deviation: tuple[float, ...] = ()
    """Standard deviation of each number of its action when its training ended; empty if nobody kept it."""

    @property
    def observed(self) -> tuple[str, ...]:
        """Names of the terms that its network takes."""
        return self.layout.names

    def action(self, terms: Terms, past: Tensor) -> Tensor:
        """(N, J) its mean action on terms that hold at least those of its layout that the task has.

        `past` (N, (F - 1) O) is what its network saw in the frames before; see track.history.
        """
        return self.network(torch.cat([past, self.layout.flat(terms)], -1))

    def target(self, robot: Robot, terms: Terms, action: Tensor) -> Tensor:
        """(N, J) joint targets [rad] of an action on terms, whose `last_action` is the one before it."""
        before = terms.get("last_action", action)
        return self.spec.aim(robot, self.spec.next_joint_pos(robot, terms), action, before, self.settings)

    def actions_of(self, robot: Robot, terms: Terms, target: Tensor) -> Tensor:
        """(N, J) the actions whose `target` on terms, `last_action` among them, these joint targets (N, J) are."""
        following = self.spec.next_joint_pos(robot, terms)
        return self.spec.aimed(robot, following, target, terms["last_action"], self.settings)


def flat(terms: Terms, names: tuple[str, ...]) -> Tensor:
    """(N, size) terms laid out one after the other."""
    return torch.cat([terms[name].flatten(1) for name in names], -1)


def sizes(names: tuple[str, ...], robot: Robot, task: Task) -> list[int]:
    """Numbers in each of the terms, of one robot."""
    return [math.prod(TERMS[name].shape(robot, task)) for name in names]
