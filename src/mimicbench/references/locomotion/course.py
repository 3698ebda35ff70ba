"""What a task asks for, wherever its person is: a stop to walk to, the way there, and what follows on standing feet."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.references.body.body import Body
from mimicbench.references.locomotion.gait import Footsteps, Gait
from mimicbench.references.locomotion.route import Route, left_of
from mimicbench.references.locomotion.walking import Walk, follow

BEFORE = 0.5
"""The action begins so long before the last foot has landed, at most [s]."""
REST = 2.5
"""How long people rest at the end of an action that others join [s]."""


AXES = np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.3]])
"""In front of and above the pelvis, two points that tell how it is turned [m]."""


@dataclass(frozen=True)
class Course:
    """One way to do a task on one object in one style; nothing in it depends on the start."""

    body: Body
    gait: Gait
    stop_xy: np.ndarray
    """(2,) where the point between the ankles comes to stand [m]."""
    stop_yaw: float
    """And its heading there [rad]."""
    route: Callable[[np.ndarray], Route]
    """The way from a place (2,) [m] to in front of the stop."""
    after: float
    """From the last touch-down until the person is at rest and K has held [s]."""
    act: Callable[[str, Walk], HumanMotion]
    """The clip of some id that follows from a walk to the stop, all of its frames."""

    @cached_property
    def action(self) -> HumanMotion:
        """What somebody does who stands at the stop already: the first frame is BEFORE seconds before the last
        touch-down, the end rests.
        """
        none = np.zeros(0)
        steps = Footsteps(self.feet_xy, self.stop_yaw, np.zeros(0, int), np.zeros((0, 2)), none, none, none)
        way = follow(self.body, steps, self.gait, BEFORE + self.after + REST)
        return self.act("action", replace(way, time=way.time - BEFORE))

    @property
    def feet_xy(self) -> np.ndarray:
        """(2, 2) left and right ankle of who stands at the stop [m]."""
        left = 0.5 * self.gait.width * self.body.size * left_of(self.stop_yaw)
        return np.stack([self.stop_xy + left, self.stop_xy - left])

    @cached_property
    def marks(self) -> tuple[np.ndarray, np.ndarray]:
        """Places (T, J + 2, 3) [m] of the action's landmarks and their velocities [m/s]."""
        places = landmarks(*self.action.forward_kinematics())
        return places, np.gradient(places, 1.0 / self.action.fps, axis=0)


def landmarks(pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """(T, J + 2, 3) joints at (T, J, 3) [m] with orientations (T, J, 4), and two points that tell how the pelvis is
    turned.
    """
    return np.concatenate([pos, pos[:, :1] + rot.rotate(quat[:, :1], AXES)], 1)
