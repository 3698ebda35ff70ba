"""Judges N running episodes: K as the task defines it, P by mechanical effort, and what went wrong."""

from collections.abc import Sequence

import numpy as np

from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.physics import LinkState, Physics
from mimicbench.tasks.task import BodyPoints, ObjectFacts, Task

FALLEN_TILT = 1.2
"""[rad] A robot whose root leans farther than this from upright counts as fallen, where lying is not the task."""
FALLEN_DROP = 0.15
"""[m] So does one whose root is this much below the seat."""


_UPRIGHT = float(np.cos(FALLEN_TILT))


class Judge:
    """Sees every control step of N episodes and keeps their verdicts. Policies never see a judge."""

    def __init__(
        self,
        task: Task,
        robot: Robot,
        objects: Sequence[SceneObject],
        control_dt: float,
        wrist_goals: Sequence[np.ndarray] | None = None,
    ) -> None:
        """`wrist_goals` are (2, 3) or empty for each episode, if the task has such goals."""
        self._task, self._robot, self._dt = task, robot, control_dt
        self._facts = ObjectFacts.of(objects, wrist_goals)
        self._hold_frames = task.hold_frames(1 / control_dt)
        self._lowest = _lowest(self._facts)
        n = len(objects)
        self.run = np.zeros(n, int)
        """(N,) frames in a row that the condition holds now."""
        self.success = np.zeros(n, bool)
        """(N,) K was fulfilled at some time; of a task that is judged in its last frame: K holds in the last frame
        seen."""
        self.first_success = np.full(n, np.nan)
        """(N,) when, [s]."""
        self.success_at_end = np.zeros(n, bool)
        """(N,) the condition held for the hold time up to the last frame seen."""
        self.max_effort = np.zeros(n)
        """(N,) largest e_i up to now [W^2]."""
        self.effort_at_success = np.full(n, np.nan)
        """(N,) largest e_i up to the moment that K was fulfilled."""
        self.fell = np.zeros(n, bool)
        """(N,) whether the robot fell."""
        self.diverged = np.zeros(n, bool)
        """(N,) whether the physics broke down."""
        self.steps = np.zeros(n, int)
        """(N,) control steps seen."""

    @property
    def wrist_goal_w(self) -> np.ndarray:
        """(N, 2, 3) where left and right wrist are to go [m]; NaN without such a goal."""
        return self._facts.wrist_goal_w

    def restart(
        self, ids: np.ndarray, objects: Sequence[SceneObject], wrist_goals: Sequence[np.ndarray] | None = None
    ) -> None:
        """Forget the episodes `ids` (n,), which begin anew with these objects and goals."""
        fresh = ObjectFacts.of(objects, wrist_goals)
        self._facts.exchange(ids, fresh)
        self._lowest[ids] = _lowest(fresh)
        for counts in (self.run, self.steps, self.max_effort):
            counts[ids] = 0
        for verdicts in (self.success, self.success_at_end, self.fell, self.diverged):
            verdicts[ids] = False
        for unknown in (self.first_success, self.effort_at_success):
            unknown[ids] = np.nan

    def see(self, physics: Physics, active: np.ndarray, links: LinkState | None = None) -> None:
        """Look at one control step of the episodes `active` (N,) bool; call it after a step that measured effort.

        `links` are the physics' links now, if they are at hand already.
        """
        links = links or physics.links()
        pos_w, quat_w = links.pos_w.cpu().numpy(), links.quat_w.cpu().numpy()
        facts = self._facts.moved(*physics.object_pose()) if physics.objects[0].movable else self._facts
        self.diverged |= physics.diverged.cpu().numpy() & active
        active = active & ~self.diverged
        self.steps += active
        holds = self._task.holds(BodyPoints.of(self._robot, pos_w, quat_w), facts)
        self.run = np.where(active, (self.run + 1) * holds, self.run)
        np.maximum(self.max_effort, physics.effort.cpu().numpy(), out=self.max_effort, where=active)
        held = self.run >= self._hold_frames
        new = held & active & np.isnan(self.first_success)
        if new.any():
            self.first_success[new] = self.steps[new] * self._dt
            self.effort_at_success[new] = self.max_effort[new]
        self.success_at_end = np.where(active, held, self.success_at_end)
        self.success = self.success_at_end.copy() if self._task.in_last_frame else self.success | new
        fallen = pos_w[:, 0, 2] < self._lowest
        if self._task.upright:
            x, y = quat_w[:, 0, 1], quat_w[:, 0, 2]
            fallen |= 1 - 2 * (x * x + y * y) < _UPRIGHT  # how much of the root's own z axis points upwards
        self.fell |= active & fallen

    def over(self, linger: float = 0.0) -> np.ndarray:
        """(N,) whether there is nothing left to see: K has been fulfilled for `linger` [s], or the physics broke
        down.
        """
        if self._task.in_last_frame:
            return self.diverged.copy()
        return self.diverged | (self.success & (self.steps * self._dt >= self.first_success + linger - 0.5 * self._dt))

    def effort(self) -> np.ndarray:
        """(N,) the e that P is judged by: up to the fulfilment of K, where the episode ends, or to the last frame."""
        ended = self.success & (not self._task.in_last_frame)
        return np.where(ended, self.effort_at_success, self.max_effort)


def _lowest(facts: ObjectFacts) -> np.ndarray:
    """(N,) below what height of the root a robot has fallen [m]."""
    return np.where(np.isnan(facts.seat_height), 0.3, facts.seat_height) - FALLEN_DROP
