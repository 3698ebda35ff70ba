"""What is on the page now: an item's bodies in the scene, at a moment in time."""

from __future__ import annotations

import sys
import threading
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.names import printable
from mimicbench.viewer.figures import Figure, Look, Wardrobe, object_meshes
from mimicbench.viewer.opened import Opened
from mimicbench.viewer.tracks import Track

if TYPE_CHECKING:
    import viser

LOOKS = {
    "human": Look(),
    "retargeted": Look((70, 130, 200), 0.35),
    "robot": Look(),
    "other": Look((222, 130, 60)),
}
"""How each body looks: the clip that is to be followed as a ghost, a second method in another color."""
_GOAL_COLOR, _GOAL_RADIUS = (230, 33, 30), 0.022
_APART = 1.2
"""[m] Between the objects of two methods that are shown side by side."""


class Actor:
    """A body in the scene that goes the way of a track, with the object that it moves or that stands beside it."""

    def __init__(self, track: Track, body: Figure, obj: Figure | None) -> None:
        self.track, self.body, self.obj, self.visible = track, body, obj, True

    def show(self, time: float) -> None:
        """Be where the track is at a time [s]."""
        if not self.visible or not len(self.track):
            return
        pose = self.track.pose(frame_at(self.track, time))
        self.body.place(pose.pos_w, pose.quat_w)
        if self.obj is not None:
            self.obj.place(pose.object_pos_w[None], pose.object_quat_w[None])

    def hide(self, hidden: bool) -> None:
        """Leave the scene, or come back."""
        self.visible = not hidden
        for figure in (self.body, self.obj):
            if figure is not None:
                figure.show(not hidden)

    def shift(self, offset: np.ndarray) -> None:
        """Be shown beside where it is."""
        for figure in (self.body, self.obj):
            if figure is not None:
                figure.shift(offset)

    def remove(self) -> None:
        """Leave for good."""
        for figure in (self.body, self.obj):
            if figure is not None:
                figure.remove()


def frame_at(track: Track, time: float) -> int:
    """The frame of a track at a time [s]: its last one if that is over."""
    return max(0, min(len(track) - 1, round(time * track.fps)))


class Session:
    """One page. What several browsers see of it is the same."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.server, self.lock = server, threading.RLock()
        self.opened: Opened | None = None
        self.actors: dict[str, Actor] = {}
        """By what they are, as in LOOKS."""
        self.time = 0.0
        """[s] The moment that is shown."""
        self.hidden: set[str] = set()
        """Which of them the user does not want to see."""
        self.horizon = 0.0
        """[s] Until when somebody may go on acting."""
        self.opening: list[Callable[[], None]] = []
        """Called when another item is opened, or none is any more, before anybody is told that it was."""
        self.changed: list[Callable[[], None]] = []
        """Called when another item was opened, or somebody came or went."""
        self.moved: list[Callable[[], None]] = []
        """Called when another moment is shown."""
        self._wardrobe, self._fixed = Wardrobe.empty(), []

    def open(self, opened: Opened) -> None:
        """Show an item from its beginning."""
        self.clear()
        self.opened, self.time, self.horizon = opened, 0.0, 0.0
        meshes = object_meshes(opened.obj)
        if not opened.obj.movable or not opened.tracks:
            still = Figure(self.server, "object", meshes, Look())
            still.place(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
            self._fixed.append(still)
        for goal in opened.wrist_goal_w[np.isfinite(opened.wrist_goal_w).all(-1)]:
            name = f"/goal/{len(self._fixed)}"
            ball = self.server.scene.add_icosphere(name, radius=_GOAL_RADIUS, color=_GOAL_COLOR, position=goal)
            self._fixed.append(ball)
        for name, track in opened.tracks.items():
            self.enter(name, track)
        self._look_at(opened)
        for told in self.opening:
            told()
        self.tell_changed()

    def empty(self) -> None:
        """Show nothing, so that nobody acts beside what is no longer listed."""
        self.clear()
        self.opened, self.time, self.horizon = None, 0.0, 0.0
        for told in self.opening:
            told()
        self.tell_changed()

    def enter(self, name: str, track: Track) -> None:
        """Let somebody into the scene, in place of who was called the same."""
        assert self.opened is not None
        self.leave(name)
        look, obj = LOOKS[name], self.opened.obj
        meshes = self._wardrobe.body(track.figure, obj)
        body = Figure(self.server, name, meshes, look)
        own = (
            Figure(self.server, f"{name}-object", object_meshes(obj), look) if obj.movable or name == "other" else None
        )
        actor = self.actors[name] = Actor(track, body, own)
        actor.hide(name in self.hidden)
        actor.show(self.time)

    def leave(self, name: str) -> None:
        """Take somebody out of the scene, if they are there."""
        actor = self.actors.pop(name, None)
        if actor is not None:
            actor.remove()

    def clear(self) -> None:
        """Take everything out of the scene."""
        for name in list(self.actors):
            self.leave(name)
        for thing in self._fixed:
            thing.remove()
        self._fixed.clear()

    @property
    def duration(self) -> float:
        """[s] of the longest track, and of what may still come."""
        ends = [(len(actor.track) - 1) / actor.track.fps for actor in self.actors.values()]
        return max([self.horizon, *ends])

    def show(self, time: float) -> None:
        """Show a moment [s]."""
        self.time = min(max(0.0, time), self.duration)
        with self.server.atomic():
            for actor in self.actors.values():
                actor.show(self.time)
        self.server.flush()
        for told in self.moved:
            told()

    def hide(self, name: str, hidden: bool) -> None:
        """Whether somebody is seen, now and when they come again."""
        (self.hidden.add if hidden else self.hidden.discard)(name)
        if name in self.actors:
            self.actors[name].hide(hidden)
            self.actors[name].show(self.time)

    def apart(self, name: str, beside: bool) -> None:
        """Show somebody side by side with the others, or among them."""
        if name in self.actors and self.opened is not None:
            low, high = self.opened.obj.bounds()
            width = float(high[1] - low[1]) + _APART if beside else 0.0
            self.actors[name].shift(np.array([0.0, -width, 0.0]))
            self._look_at(self.opened, width)

    def tell_changed(self) -> None:
        """Say that somebody came or went."""
        for told in self.changed:
            told()

    def _look_at(self, opened: Opened, aside: float = 0.0) -> None:
        """Turn all cameras to an item, from the side that nobody walks on, and to who is so far beside it [m].

        Two that are side by side are seen more from the front, or one would stand before the other.
        """
        paths = [track.pos_w[:, 0] for track in opened.tracks.values()]
        low, high = opened.obj.bounds()
        points = np.concatenate([low[None], high[None], *paths])
        side = -1.0 if paths and points[2:, 1].mean() > 0 else 1.0
        points = np.concatenate([points, points - (0.0, aside, 0.0)])
        low, high = points.min(0), points.max(0)
        middle = np.array([*(low + high)[:2] / 2, 0.75])
        distance = 1.9 + 1.1 * float(np.linalg.norm((high - low)[:2]))
        away = np.array([0.86, 0.35 * side, 0.42]) if aside else np.array([0.62, 0.70 * side, 0.42])
        position = middle + distance * away
        camera = self.server.initial_camera
        camera.position, camera.look_at = position, middle
        for client in self.server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = position, middle

    def safely(self, function: Callable[..., object]) -> Callable[..., None]:
        """The function as the page calls it: one at a time, and what goes wrong is told there."""

        def inside(*arguments: Any) -> None:
            try:
                with self.lock:
                    function(*arguments)
            except MimicbenchError as error:
                self.tell("This cannot be shown", str(error))
            except Exception as error:  # noqa: BLE001 the page goes on whatever happens, and the terminal has the rest
                traceback.print_exc(file=sys.stderr)
                self.tell("Something went wrong", printable(f"{type(error).__name__}: {error}"))

        return inside

    def tell(self, title: str, words: str) -> None:
        """A notice in all browsers."""
        for client in self.server.get_clients().values():
            client.add_notification(title, words, color="red", auto_close_seconds=12.0)
