"""What the robot's color cameras see, drawn in a process of its own.

OpenGL belongs to one thread, and graphics drivers crash: the page goes on without these pictures if they do.
"""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache

import numpy as np

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.parallel import refuse_without_guard, start_worker
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.pictures import CameraPictures
from mimicbench.tasks.registry import TASKS
from mimicbench.viewer.sensing import CAMERA_PIXELS, camera_order


@dataclass(frozen=True)
class Look:
    """A moment to be drawn."""

    robot: str
    task: str
    obj: SceneObject
    qpos: np.ndarray
    """(nq,) of the scene."""
    wrist_goal_w: np.ndarray
    """(2, 3) or (0, 3), NaN for a wrist without a goal [m]."""


class ColorCameras:
    """Draws one moment after the other; of those that are asked for meanwhile only the last. Close it after use."""

    def __init__(self, show: Callable[[np.ndarray | str], None]) -> None:
        """`show` is given pictures (C, rows, columns, 3), or why there are none, from another thread."""
        self._show, self._lock = show, threading.Lock()
        self._pool: ProcessPoolExecutor | None = None
        self._wanted: Look | None = None
        self._busy = self._closed = False

    def ask(self, look: Look) -> None:
        """Draw this next. Raises MimicbenchError in a script that does its work when it is imported."""
        with self._lock:
            self._wanted = look
        self._start()

    def close(self) -> None:
        """End the process that draws."""
        with self._lock:
            self._closed, pool, self._pool = True, self._pool, None
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)

    def _start(self) -> None:
        with self._lock:
            if self._busy or self._closed or self._wanted is None:
                return
            if self._pool is None:
                refuse_without_guard()
                context = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(1, mp_context=context, initializer=start_worker)
            look, self._wanted, self._busy = self._wanted, None, True
            drawn = self._pool.submit(drawn_colors, look)
        drawn.add_done_callback(self._done)

    def _done(self, drawn: Future[np.ndarray]) -> None:
        if drawn.cancelled():
            return
        found: np.ndarray | str
        try:
            found = drawn.result()
        except MimicbenchError as error:
            found = str(error)
        except BrokenProcessPool:
            found = "the graphics driver crashed; another one may be had with MUJOCO_GL"
            with self._lock:
                self._pool = None
        with self._lock:
            self._busy = False
            if self._closed:
                return
        self._show(found)
        self._start()


def drawn_colors(look: Look) -> np.ndarray:
    """Pictures (C, rows, columns, 3), uint8, with the goals of wrists marked as in observations. Raises NoPictures."""
    goals = look.wrist_goal_w[np.isfinite(look.wrist_goal_w).all(-1)]
    seen = _cameras(look.robot, look.task).look(0, look.obj, look.qpos, goals)
    return seen.color[camera_order(TASKS.get(look.task).rig)]


@cache
def _cameras(robot: str, task: str) -> CameraPictures:
    return CameraPictures(ROBOTS.get(robot), TASKS.get(task).rig, *CAMERA_PIXELS)
