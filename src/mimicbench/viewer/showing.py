"""The panel with what is seen, and what it comes to at this moment."""

from __future__ import annotations

import base64
import html
import io
import time
from typing import Any

import numpy as np
from PIL import Image

from mimicbench.evaluate.rows import ENERGY_LIMITS
from mimicbench.viewer.acting import ROLES, ActPanel
from mimicbench.viewer.coloring import ColorCameras, Look
from mimicbench.viewer.markdown import plain
from mimicbench.viewer.opened import Opened
from mimicbench.viewer.sensing import (
    Probe,
    camera_order,
    depth_picture,
    elevation,
    map_picture,
    raised_cells,
    side_by_side,
)
from mimicbench.viewer.session import LOOKS, Actor, Session, frame_at

CALLED = {"human": "Human", "retargeted": "Retargeted (ghost)", "robot": "Robot", "other": "Second robot"}
"""What bodies are called beside their boxes."""
_SEEING = ("robot", "other", "retargeted")
"""Whose map is shown: the first of them that is there."""
_SENSES_PER_SECOND = 5.0


class ShowPanel:
    """Who is seen, what K says of each, and what the robot sees and feels."""

    def __init__(self, session: Session, act: ActPanel) -> None:
        self.session, self.act = session, act
        gui, on = session.server.gui, session.safely
        with gui.add_folder("Now", order=3.0):
            self.words = gui.add_markdown("")
        with gui.add_folder("Show", order=5.0):
            self.boxes = {name: gui.add_checkbox(CALLED[name], True) for name in LOOKS}
            self.map = gui.add_checkbox("Elevation map", False, hint="as the robot sees it")
            self.cameras = gui.add_checkbox("Depth cameras", False, hint="of who is under physics")
            self.colors = gui.add_checkbox("Color cameras", False, hint="of who is under physics; needs OpenGL")
            self.contacts = gui.add_checkbox("Contact forces", False)
            self.pictures = {name: gui.add_html("", visible=False) for name in ("map", "cameras", "colors")}
        for name, box in self.boxes.items():
            box.on_update(on(lambda event, name=name, box=box: self._see(name, box.value)))
        for box in (self.map, self.cameras, self.colors, self.contacts):
            box.on_update(on(lambda event: self._sense()))
        self._said, self._sensed, self._probe = "", 0.0, Probe()
        self._painter = ColorCameras(self._show_colors)
        self._drawn: dict[str, Any] = {}
        self._asked: set[str] = set()
        """Who has been asked to make room,"""
        self._aside: set[str] = set()
        """and who has, not having been hidden before."""
        session.changed.append(self._changed)
        session.moved.append(self._moved)

    def close(self) -> None:
        """End what draws."""
        self._painter.close()

    def _see(self, name: str, seen: bool) -> None:
        """Whether somebody is seen, and told of."""
        self.session.hide(name, not seen)
        self._moved()

    def _changed(self) -> None:
        self._make_room()
        for name, box in self.boxes.items():
            box.disabled = name not in self.session.actors
        self._moved()
        self._sense()

    def _make_room(self) -> None:
        """Hide the person where a robot is under physics, and the clip unless it is followed: they would stand in it.

        Whoever ticks their boxes again sees them, and they come back with the next item that has no such robot.
        """
        episodes, opened = self.act.episodes.values(), self.session.opened
        recorded = opened is not None and opened.policy is None  # demonstrations follow their clip
        followed = any(episode.follows for episode in episodes) if episodes else recorded
        simulated = any(role in self.session.actors for role in ROLES)
        asked = {"human", *(() if followed else ("retargeted",))} if simulated else set()
        hidden = {name for name in asked - self._asked if self.boxes[name].value}
        for name in hidden | (self._aside - asked):
            self.boxes[name].value = name not in asked
            self.session.hide(name, name in asked)
        self._aside, self._asked = (self._aside | hidden) & asked, asked

    def _moved(self) -> None:
        seen = [name for name, actor in self.session.actors.items() if actor.visible]
        nobody = "*an object; nobody moves*" if self.session.opened is not None else "*nothing is shown*"
        said = "\n\n".join(self._of(name) for name in seen) or nobody
        if said != self._said:
            self._said = self.words.content = said
        if time.monotonic() - self._sensed > 1 / _SENSES_PER_SECOND or not self.act.play.playing:
            self._sense()

    def _of(self, name: str) -> str:
        """What K, P and the judge say of somebody at this moment."""
        track, opened = self.session.actors[name].track, self.session.opened
        assert opened is not None
        frame, done = frame_at(track, self.session.time), track.fulfilled()
        lacks = track.lacks(frame)
        now = (
            f"K lacks: {plain(lacks)}" if lacks else f"K's condition holds ({opened.task.hold_time:g} s are asked for)"
        )
        if done is None:
            ever = "K not fulfilled"
        elif frame >= done:
            ever = f"**K fulfilled** at {done / track.fps:.1f} s"
        else:
            ever = f"K will be fulfilled at {done / track.fps:.1f} s"
        lines = [f"**{plain(track.title)}** · {ever}", now]
        curves = track.curves()
        if curves is not None:
            lines.append(told_power(float(curves.effort[: curves.until(frame / track.fps)].max(initial=0.0))))
        if name in self.act.episodes:
            lines.append(plain(self.act.episodes[name].verdict()))
        return "  \n".join(lines)

    def _seeing(self) -> Actor | None:
        found = [self.session.actors[name] for name in _SEEING if name in self.session.actors]
        return next((actor for actor in found if actor.visible), None)

    def _sense(self) -> None:
        """Show the map, the cameras' pictures and the contacts of this moment, or take them away."""
        self._sensed = time.monotonic()
        actor, opened = self._seeing(), self.session.opened
        drawn = self._draw(actor, opened) if actor is not None and opened is not None and len(actor.track) else {}
        for name in set(self._drawn) - set(drawn):
            self._drawn[name].remove()
        self._drawn = drawn
        self.pictures["map"].visible = "map" in drawn
        self._look(actor, opened)

    def _look(self, actor: Actor | None, opened: Opened | None) -> None:
        """Show what the cameras see, or nothing."""
        state = None
        if (self.cameras.value or self.colors.value) and actor is not None and opened is not None and len(actor.track):
            state = actor.track.state(frame_at(actor.track, self.session.time))
        self.pictures["cameras"].visible = state is not None and self.cameras.value
        self.pictures["colors"].visible = state is not None and self.colors.value
        if state is None or opened is None:
            return
        if self.cameras.value:
            order = camera_order(opened.task.rig)
            depth = self._probe.depth(opened.robot, opened.obj, state, opened.task.rig)[order]
            self.pictures["cameras"].content = _picture(depth_picture(depth), _named("Depth", opened))
        if self.colors.value:
            look = Look(opened.robot.name, opened.task.name, opened.obj, state.qpos, opened.wrist_goal_w)
            self._painter.ask(look)

    def _show_colors(self, found: np.ndarray | str) -> None:
        """Show what the color cameras saw, or why they did not; called when it has been drawn, from another thread."""
        opened = self.session.opened
        if isinstance(found, str) or opened is None:
            self.pictures["colors"].content = f"<div>{html.escape(str(found))}</div>"
        else:
            self.pictures["colors"].content = _picture(side_by_side(found), _named("Color", opened))

    def _draw(self, actor: Actor, opened: Opened) -> dict[str, Any]:
        """What of it is in the scene now, each in place of what had its name."""
        frame, scene, drawn = frame_at(actor.track, self.session.time), self.session.server.scene, {}
        pose = actor.track.pose(frame)
        if self.map.value:
            cell = opened.task.map_cell
            heights = elevation(opened.task, opened.obj, pose)
            points, colors = raised_cells(heights, cell, pose)
            drawn["map"] = scene.add_point_cloud("/map", points, colors, point_size=cell / 2, point_shape="square")
            shown = map_picture(heights, float(pose.pos_w[0, 2]))
            self.pictures["map"].content = _picture(shown, "Elevation map, ahead is up")
        state = actor.track.state(frame) if self.contacts.value else None
        arrows = None if state is None else self._probe.forces(opened.robot, opened.obj, state)
        if arrows is not None and len(arrows):
            drawn["contacts"] = scene.add_arrows(
                "/contacts", arrows, (214, 39, 40), shaft_radius=0.008, head_radius=0.02, head_length=0.04
            )
        return drawn


def _named(what: str, opened: Opened) -> str:
    """What pictures of the cameras show, with the names of these in order."""
    mounts = opened.task.rig.mounts
    return f"{what}: " + ", ".join(mounts[at].name for at in camera_order(opened.task.rig))


def told_power(most: float) -> str:
    """What the largest e by now [W^2] means for P."""
    held = [f"{limit / 1e6:.0f}e6" for limit in ENERGY_LIMITS if most < limit]
    which = "every λ" if len(held) == len(ENERGY_LIMITS) else f"λ = {', '.join(held)}" if held else "no λ"
    return f"largest e so far {most:.2g} W²: P holds for {which}"


def _picture(pixels: np.ndarray, words: str) -> str:
    """A picture below some words, as part of the page: one that is fetched might be replaced before it has come."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "png")
    data = base64.b64encode(stream.getvalue()).decode()
    inset, style = "padding: 0.3em 0.75em", "width: 100%; image-rendering: pixelated"
    return f'<div style="{inset}"><div>{words}</div><img style="{style}" src="data:image/png;base64,{data}"></div>'
