"""What N running episodes come to: K as the task defines it, P by mechanical effort, falls, and who stays."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mimicbench.robots.description import Robot
from mimicbench.sim.physics import LinkState, Physics
from mimicbench.sim.rows import Rows
from mimicbench.tasks.task import BodyPoints, ObjectInfo, Task

FALLEN_TILT = 1.2
"""[rad] A robot whose root leans farther than this from upright counts as fallen, where neither lying nor bending down
is the task."""
FALLEN_DROP = 0.15
"""[m] So does one whose root is this much below the seat."""
FALLEN_SHARE = 0.45
"""Where there is no seat, so does one whose root is below this share of its height at the start: who bends down as far
as people do for what stands on the floor keeps 0.58 of it. Beside a seat, so does one who is that low and lower than
the seat: on the floor next to a mattress 0.24 m high nobody is far below it."""
STAY = 0.3
"""[s] before the time limit over which the condition of K has to hold for a robot to have stayed."""
PHASES = ("", "walking", "turning", "acting", "after success")
"""What a robot was at; the task has a word for acting, such as sitting down. Places in this list are kept."""
_WALKING, _TURNING, _ACTING, _AFTER = range(1, 5)
_LOOK_BACK = 0.5
"""[s] A fall began so long before the robot counts as fallen: what it was at then is what it fell in."""
_NEAR = 0.35
"""[m] Whose root is no farther from the object's rectangle acts on it, unless it still turns."""
_LOWERED = 0.92
"""Whose root is below this share of its height at the start acts, too, if near; it has begun to go down."""
_TURN_RATE = 0.6
"""[rad/s] Who turns faster than this on the spot is turning."""
_SEEN = (
    *("run", "steps", "held", "ever", "fell", "diverged"),
    *("first_success", "fell_time", "max_effort", "effort_at_success", "fell_phase", "_phases"),
)
"""What metrics keep of every episode, by the names of their tensors."""
_UPRIGHT = float(torch.cos(torch.tensor(FALLEN_TILT, dtype=torch.float64)))


@dataclass(frozen=True)
class Verdict:
    """What E episodes came to, one row an episode, on the host."""

    success: Tensor
    """(E,) bool: K was fulfilled; of a task that is judged in its last frame: K holds there."""
    success_at_end: Tensor
    """(E,) bool: the condition held for the hold time up to the last frame."""
    stays: Tensor
    """(E,) bool: the condition held over the last 0.3 s, or as long as K asks where that is longer, and the robot has
    not fallen. Only at the time limit."""
    first_success: Tensor
    """(E,) when K was first fulfilled [s]; NaN if never."""
    fell: Tensor
    """(E,) bool."""
    fell_time: Tensor
    """(E,) when [s]; NaN if it did not."""
    fell_phase: Tensor
    """(E,) place in PHASES of what it was at when its fall began; 0 if it did not fall."""
    diverged: Tensor
    """(E,) bool: the physics broke down."""
    effort: Tensor
    """(E,) e that P is judged by [W^2]: the largest up to the fulfilment of K, where the protocol ends an episode, or
    to the last frame."""
    steps: Tensor
    """(E,) control steps seen."""


class EpisodeMetrics:
    """Sees every control step of N episodes and keeps what they come to. Policies never see it."""

    def __init__(self, task: Task, robot: Robot, physics: Physics, control_dt: float) -> None:
        self.task, self.robot, self.control_dt = task, robot, control_dt
        n, device = physics.num_envs, physics.device
        self._physics, self._hold_frames = physics, task.hold_frames(1 / control_dt)
        # on the CPU, calls of NumPy cost a fraction of torch's
        self._xp: Any = torch if physics.asynchronous else np
        self._catalog = ObjectInfo.of(physics.catalog).map(lambda array: torch.from_numpy(array).to(device))
        self.info = self._catalog.map(lambda array: array[physics.object_index].clone())
        """What K needs to know of each scene's object and goal."""
        self._info = self.info.map(self._own)
        zeros = {"dtype": torch.long, "device": device}
        self.run, self.steps = torch.zeros(n, **zeros), torch.zeros(n, **zeros)
        """(N,) frames in a row that the condition holds now; control steps seen."""
        self.held, self.ever, self.fell, self.diverged = (
            torch.zeros(n, dtype=torch.bool, device=device) for _ in range(4)
        )
        """(N,) the condition has held for the hold time; it once had; the robot fell; the physics broke down."""
        self.first_success, self.fell_time, self.max_effort, self.effort_at_success, self.start_height = (
            torch.full((n,), unknown, dtype=torch.float64, device=device)
            for unknown in (torch.nan, torch.nan, 0.0, torch.nan, torch.inf)
        )
        self.fell_phase = torch.zeros(n, **zeros)
        self._phases = torch.zeros(max(1, round(_LOOK_BACK / control_dt)), n, dtype=torch.uint8, device=device)
        """(_, N) what they were at over the last half a second, a ring in which `_place` is the latest."""
        self._place = 0
        self._lowest = _lowest(self.info, self.start_height)
        """(N,) below what height of the root a robot has fallen [m]."""
        # all of these are only ever written in place, so that arrays of the same memory are made once
        self._arrays = SimpleNamespace(
            **{name: self._own(getattr(self, name)) for name in (*_SEEN, "start_height", "_lowest")}
        )

    def begin(self, rows: Rows, wrist_goal_w: Tensor, root_pos_w: Tensor) -> None:
        """Episodes `rows` begin anew, with the objects that their scenes have now, goals (n, 2, 3) and all roots at
        (N, 3).
        """
        self._learn_new_objects()
        index = self._physics.object_index[rows.ids]
        fresh = self._catalog.map(lambda array: array[index])
        for name, there in vars(self.info).items():
            rows.put(there, wrist_goal_w if name == "wrist_goal_w" else getattr(fresh, name))
        for counts in (self.run, self.steps, self.max_effort, self.fell_phase):
            rows.put(counts, 0)
        for verdicts in (self.held, self.ever, self.fell, self.diverged):
            rows.put(verdicts, False)
        for unknown in (self.first_success, self.effort_at_success, self.fell_time):
            rows.put(unknown, torch.nan)
        height = root_pos_w[rows.ids, 2].double()
        rows.put(self.start_height, height)
        rows.put(self._lowest, _lowest(fresh, height))
        rows.put(self._phases.T, 0)

    def _learn_new_objects(self) -> None:
        known, catalog = len(self._catalog.seat_height), self._physics.catalog
        if len(catalog) > known:
            more = ObjectInfo.of(catalog[known:]).map(lambda array: torch.from_numpy(array).to(self._physics.device))
            joined = {name: torch.cat([array, getattr(more, name)]) for name, array in vars(self._catalog).items()}
            self._catalog = ObjectInfo(**joined)

    def update(self, links: LinkState, active: Tensor | None = None) -> None:
        """Look at one control step of the episodes `active` (N,) bool (None: all), after a step that measured effort.

        `links` are where the robots' links are now.
        """
        xp, own, info = self._xp, self._arrays, self._info
        broke, effort = self._own(self._physics.diverged), self._own(self._physics.effort)
        looked_at = True if active is None else self._own(active)
        own.diverged |= broke & looked_at
        alive = ~own.diverged & looked_at
        own.steps += alive
        now = xp.asarray(own.steps, dtype=xp.float64) * self.control_dt
        if self._physics.catalog[0].movable:
            obj = self._physics.object_state()
            info = info.moved(self._own(obj.pos_w.double()), self._own(obj.quat_w.double()))
        pos_w, quat_w = self._own(links.pos_w), self._own(links.quat_w)
        holds = self.task.holds(BodyPoints.of(self.robot, pos_w, quat_w), info)
        own.run[...] = xp.where(alive, (own.run + 1) * holds, own.run)
        own.max_effort[...] = xp.where(alive, xp.maximum(own.max_effort, effort), own.max_effort)
        held = own.run >= self._hold_frames
        new = held & alive & ~own.ever
        own.first_success[...] = xp.where(new, now, own.first_success)
        own.effort_at_success[...] = xp.where(new, own.max_effort, own.effort_at_success)
        own.held[...] = xp.where(alive, held, own.held)
        own.ever |= new
        outside = outside_of(pos_w[:, 0], info, xp)
        fallen = self._is_down(pos_w[:, 0], quat_w[:, 0], outside, info) & alive & ~own.fell
        self._place = (self._place + 1) % len(own._phases)  # the oldest is overwritten after it was read
        began = own._phases[self._place]
        own.fell_phase[...] = xp.where(fallen, began.clip(_WALKING), own.fell_phase)
        own.fell_time[...] = xp.where(fallen, now, own.fell_time)
        own.fell |= fallen
        own._phases[self._place] = self._phase(pos_w[:, 0], self._own(links.ang_vel_w)[:, 0, 2], outside)

    def _own(self, tensor: Tensor) -> Any:
        """A tensor as an array of the library that works things out here, of the same memory."""
        return tensor if self._xp is torch else tensor.numpy()

    def _is_down(self, root_pos_w: Any, root_quat_w: Any, outside: Any, info: ObjectInfo) -> Any:
        """(N,) who is as low, or leans as far, as who has fallen, from roots (N, 3) and (N, 4), outside (N,) [m]."""
        height = root_pos_w[:, 2]
        own = self._arrays
        beside = (outside > 0) & (height < info.seat_height) & (height < FALLEN_SHARE * own.start_height)
        low = (height < own._lowest) | beside
        if not self.task.upright:
            return low
        x, y = root_quat_w[:, 1], root_quat_w[:, 2]
        return low | (1 - 2 * (x * x + y * y) < _UPRIGHT)  # how much of the root's own z axis points upwards

    def _phase(self, root_pos_w: Any, turning: Any, outside: Any) -> Any:
        """(N,) what each robot is at now, a place in PHASES, from roots (N, 3) that turn about z (N,) [rad/s]."""
        xp, own = self._xp, self._arrays
        near = outside <= _NEAR
        lowered = root_pos_w[:, 2] < _LOWERED * own.start_height
        phase = xp.where(near, _ACTING, _WALKING)
        phase = xp.where((abs(turning) > _TURN_RATE) & ~(near & lowered), _TURNING, phase)
        return xp.where(own.ever, _AFTER, phase)

    @property
    def success(self) -> Tensor:
        """(N,) K was fulfilled at some time; of a task that is judged in its last frame: K holds now."""
        return self.held.clone() if self.task.in_last_frame else self.ever.clone()

    @property
    def stays(self) -> Tensor:
        """(N,) the condition has held over the last 0.3 s, or as long as K asks where that is longer, and the robot has
        not fallen: asked at the time limit.
        """
        frames = max(self._hold_frames, round(STAY / self.control_dt))
        run, fell, diverged = self._own(self.run), self._own(self.fell), self._own(self.diverged)
        return torch.as_tensor((run >= frames) & ~fell & ~diverged)

    def over(self) -> Tensor:
        """(N,) whether the benchmark's episode is over: K has been fulfilled, or the physics broke down."""
        return self.diverged.clone() if self.task.in_last_frame else self.diverged | self.ever

    def effort(self) -> Tensor:
        """(N,) the e that P is judged by: up to the fulfilment of K, where the episode ends, or to the last frame."""
        return (
            self.max_effort
            if self.task.in_last_frame
            else torch.where(self.ever, self.effort_at_success, self.max_effort)
        )

    def verdict(self) -> Verdict:
        """What all episodes have come to by now, on the host."""
        found = {
            "success": self.success & ~self.diverged,
            "success_at_end": self.held & ~self.diverged,
            "stays": self.stays,
            "first_success": self.first_success,
            "fell": self.fell,
            "fell_time": self.fell_time,
            "fell_phase": self.fell_phase,
            "diverged": self.diverged,
            "effort": self.effort(),
            "steps": self.steps,
        }
        return Verdict(**{name: value.clone().cpu() for name, value in found.items()})

    def state_tensors(self) -> dict[str, Tensor]:
        """All that it has seen."""
        found = {name: getattr(self, name).clone() for name in (*_SEEN, "start_height", "_lowest")}
        found |= {f"info/{name}": value.clone() for name, value in vars(self.info).items()}
        return {**found, "_place": torch.tensor(self._place)}

    def load_state_tensors(self, tensors: dict[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        for name, value in tensors.items():
            if name == "_place":
                self._place = int(value)
            elif name.startswith("info/"):
                getattr(self.info, name.removeprefix("info/")).copy_(value)
            else:
                getattr(self, name).copy_(value)


def outside_of(root_pos_w: Any, info: ObjectInfo, xp: Any) -> Any:
    """(N,) how far roots (N, 3) are from the object's rectangle as seen from above [m]; 0 above it."""
    away = info.pos_w[:, :2] - root_pos_w[:, :2]
    beyond = xp.maximum(info.low[:, :2] + away, -away - info.high[:, :2]).clip(0.0)
    return xp.sqrt((beyond * beyond).sum(-1))


def _lowest(info: ObjectInfo, start_height: Tensor) -> Tensor:
    """(N,) below what height of the root a robot has fallen that started at another [m]."""
    plane = info.seat_height
    return torch.where(torch.isnan(plane), (FALLEN_SHARE * start_height).to(plane.dtype), plane - FALLEN_DROP)
