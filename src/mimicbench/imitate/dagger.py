"""What DAgger needs around a tracking environment: what each robot would see, who drives it, and what was seen."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import digest
from mimicbench.imitate.goals import given_goal, goals_of
from mimicbench.imitate.networks.planner import TaskColumns, planner_inputs
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.tracking import TrackingEnv

SEEN = ("proprio", "targets", "hands")
"""Terms that inputs are made of, those of them that the task has."""


class Normalized(Protocol):
    """A network that keeps means and deviations of what it takes and gives."""

    input_mean: Tensor
    input_std: Tensor
    plan_mean: Tensor
    plan_std: Tensor


class Episodes:
    """For each training robot: where its clip starts, its goal as it would be known from there, and its clock.

    Once a clip is over nothing changes any more but the clock, and an episode may go on until the time limit, far
    beyond what is worth simulating. So the clock jumps, at the clip's end, to a time drawn anew for every episode: a
    few seconds of holding on teach that at all of them the same is to be done.
    """

    def __init__(self, env: TrackingEnv, columns: TaskColumns, styles: Tensor, seed: int, clock: bool = True) -> None:
        """`styles` (C, S) are the clips', normalized; `clock` says whether the planner sees one."""
        self._env, self._columns, self._styles, self._clock, device = env, columns, styles, clock, env.device
        self._spec = env.clips.task.goal
        clips = torch.arange(len(env.bank), device=device)
        first = env.bank.frame(clips, torch.zeros_like(clips))
        self._start_pos, self._start_yaw = first.root_pos_w[:, :2], rot.yaw_of(first.root_quat_w)
        self._goals = self._spec.to_root(goals_of(env.clips).to(device), self._start_pos, self._start_yaw)
        limit = round((env.clips.task.time_limit - env.config.hold) / CONTROL_DT)
        self._room = (limit - env.bank.lengths).clamp(min=0)
        """(C,) frames by which the clock may jump, so that the time limit is still reached."""
        self._random = torch.Generator(device).manual_seed(digest(seed, "planner", "goal noise") % (1 << 63))
        self.known = torch.zeros(env.num_envs, self._spec.size, device=device)
        """(N, G) the goals as they are first known, with the errors that perception makes."""
        self._jump = torch.zeros(env.num_envs, dtype=torch.long, device=device)
        self.begin(torch.arange(env.num_envs, device=device))

    def tell_styles(self, styles: Tensor) -> None:
        """The clips' styles (C, S), normalized in another way."""
        self._styles = styles

    def begin(self, ids: Tensor) -> None:
        """Robots `ids` begin anew: each perceives its goal once an episode, and has another clock."""
        clip = self._env.env.clip[ids]
        self.known[ids] = self._spec.disturbed(self._goals[clip], self._random)
        share = torch.rand(len(ids), generator=self._random, device=self.known.device)
        self._jump[ids] = (share * (self._room[clip] + 1)).long()

    @property
    def seconds(self) -> Tensor:
        """(N,) what the clocks show [s]."""
        env = self._env.env
        over = env.index >= self._env.bank.lengths[env.clip]
        return (env.index + torch.where(over, self._jump, 0)) * CONTROL_DT

    @property
    def styles(self) -> Tensor:
        """(N, S) of the clips that are followed, normalized."""
        return self._styles[self._env.env.clip]

    def inputs(self, seen: Mapping[str, Tensor]) -> Tensor:
        """(N, I) what the planner sees now, of the terms SEEN."""
        seconds = self.seconds if self._clock else None
        return planner_inputs(seen["proprio"], seconds, self._columns.told(self._memory(seen)), self.styles)

    def _memory(self, seen: Mapping[str, Tensor]) -> Tensor:
        """(N, memory_size) what is known of the goals by now."""
        if self._spec.given:
            return self._spec.joined(
                self.known, given_goal(self._spec, seen["targets"], seen["hands"], seen["proprio"])
            )
        env, state = self._env.env, self._env.context.state
        start, yaw = self._start_pos[env.clip], self._start_yaw[env.clip]
        cos, sin = torch.cos(yaw), torch.sin(yaw)
        dx, dy = (state.root_pos_w[:, :2] - start).unbind(-1)
        moved = torch.stack([cos * dx + sin * dy, cos * dy - sin * dx], -1)
        return self._spec.carried(self.known, moved, rot.wrap_angle(rot.yaw_of(state.root_quat_w) - yaw))

    def state_tensors(self) -> dict[str, Tensor]:
        """What is known, what clocks show, and the random numbers to come."""
        return {"known": self.known.clone(), "jump": self._jump.clone(), "random": self._random.get_state()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.known.copy_(tensors["known"])
        self._jump.copy_(tensors["jump"])
        self._random.set_state(tensors["random"].cpu())


class Drivers:
    """Who drives each robot: the tracker on true references, or the learner."""

    def __init__(self, count: int, device: str) -> None:
        self.teacher = torch.zeros(count, dtype=torch.bool, device=device)
        """(N,) whether it is the tracker on true references."""

    def draw(self, ids: Tensor, share: float) -> None:
        """Robots `ids` begin anew; the teacher drives a share of them."""
        self.teacher[ids] = (torch.rand(len(ids)) < share).to(self.teacher.device)

    def state_tensors(self) -> dict[str, Tensor]:
        """Who drives now."""
        return {"teacher": self.teacher.clone()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.teacher.copy_(tensors["teacher"])


class Replay:
    """The most recent frames: inputs, what the tracker senses itself, label."""

    def __init__(self, size: int, widths: list[int], device: str) -> None:
        self._rows = torch.zeros(size, sum(widths), device=device)
        self._widths = widths
        self._next = self.filled = 0

    def add(self, *parts: Tensor) -> None:
        """Remember N frames, of which each part is (N, width)."""
        rows = torch.cat(parts, -1)
        at = (self._next + torch.arange(len(rows), device=rows.device)) % len(self._rows)
        self._rows[at] = rows
        self._next = (self._next + len(rows)) % len(self._rows)
        self.filled = min(self.filled + len(rows), len(self._rows))

    def draw(self, count: int) -> tuple[Tensor, ...]:
        """The parts of `count` frames at random."""
        return self._rows[torch.randint(self.filled, (count,)).to(self._rows.device)].split(self._widths, -1)

    def stored(self) -> tuple[Tensor, ...]:
        """The parts of all frames."""
        return self._rows[: self.filled].split(self._widths, -1)

    def state_tensors(self) -> dict[str, Tensor]:
        """The frames, and where the next one goes."""
        return {"rows": self._rows[: self.filled].clone(), "next": torch.tensor(self._next)}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.filled, self._next = len(tensors["rows"]), int(tensors["next"])
        self._rows[: self.filled] = tensors["rows"].to(self._rows.device)


def set_statistics(network: Normalized, replays: Sequence[Replay], columns: Sequence[TaskColumns]) -> None:
    """Set a network's normalization from what is stored of each task: of a term of the plan, over those that have it.

    The first frames are the teacher's, close to its clips: a plan is to be precise to centimeters and hundredths of a
    radian, but a robot that has got off its clip must not outweigh all others.
    """
    stored = [replay.stored() for replay in replays]
    inputs = torch.cat([inputs for inputs, _, _ in stored])
    network.input_mean.copy_(inputs.mean(0))
    network.input_std.copy_(inputs.std(0).clamp(min=0.05))
    found: dict[tuple[int, int], list[Tensor]] = {}
    for (_, _, label), where in zip(stored, columns, strict=True):
        for place, values in zip(
            where.plan, label.split([part.stop - part.start for part in where.plan], -1), strict=True
        ):
            found.setdefault((place.start, place.stop), []).append(values)
    for (start, stop), values in found.items():
        together = torch.cat(values)
        network.plan_mean[start:stop] = together.mean(0)
        network.plan_std[start:stop] = together.std(0).clamp(min=0.1)
