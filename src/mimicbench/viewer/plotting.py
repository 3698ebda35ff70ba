"""The panel with curves: effort against the limits of P, and torque and power of a joint."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from mimicbench.evaluate.rows import ENERGY_LIMITS
from mimicbench.viewer.playing import PlayPanel
from mimicbench.viewer.session import Session, frame_at
from mimicbench.viewer.tracks import Curves

ROLES = ("robot", "other")
COLORS = {"robot": "#1f77b4", "other": "#de823c"}
LIMIT_COLORS = ("#7fbf7f", "#c0b040", "#d88030", "#c03030")
TORQUE, POWER = "torque [N m]", "power [W]"
HARDEST: str = "the hardest worked"
_PER_SECOND = 4.0
_HEIGHT = 190
_EFFORTS = (1.0, 3e7)
"""[W^2] From the least that is drawn to somewhat above the largest limit."""
_AXES: Any = ({}, {"size": 82, "grid": {"show": False}, "ticks": {"show": False}})


class PlotPanel:
    """Curves of whoever has any."""

    def __init__(self, session: Session, play: PlayPanel) -> None:
        self.session, self.play = session, play
        gui, on = session.server.gui, session.safely
        self.folder = gui.add_folder("Curves", order=6.0, visible=False)
        with self.folder:
            self.effort = gui.add_uplot(
                _empty(len(ROLES) + len(ENERGY_LIMITS) + 1),
                (
                    {"label": "s"},
                    *(_line(role, COLORS[role]) for role in ROLES),
                    *(
                        _limit(f"λ {limit / 1e6:.0f}e6", color)
                        for limit, color in zip(ENERGY_LIMITS, LIMIT_COLORS, strict=True)
                    ),
                    _now(),
                ),
                title="e = Σ (torque · velocity)²  [W²]",
                scales={"x": {"time": False}, "y": {"distr": 3, "log": 10, "range": _EFFORTS}},
                axes=_AXES,
                height=_HEIGHT,
                legend={"show": True, "live": False},
            )
            self.quantity = gui.add_dropdown("Curve", (TORQUE, POWER))
            self.joint = gui.add_dropdown("Joint", [HARDEST])
            self.one = gui.add_uplot(
                _empty(len(ROLES) + 3),
                (
                    {"label": "s"},
                    *(_line(role, COLORS[role]) for role in ROLES),
                    *(_limit(words, LIMIT_COLORS[-1]) for words in ("most", "least")),
                    _now(),
                ),
                title=" ",
                scales={"x": {"time": False}, "y": {"range": (-1.0, 1.0)}},
                axes=_AXES,
                height=_HEIGHT,
                legend={"show": True, "live": False},
            )
        self._drawn = 0.0
        self._axis = "", 0.0
        for box in (self.quantity, self.joint):
            box.on_update(on(lambda event: self._draw()))
        session.changed.append(self._changed)
        session.moved.append(self._moved)

    def _changed(self) -> None:
        opened = self.session.opened
        if opened is not None:
            names = (HARDEST, *opened.robot.joint_names)
            if self.joint.options != names:
                self.joint.options = names
        self._draw()

    def _moved(self) -> None:
        if time.monotonic() - self._drawn > 1 / _PER_SECOND or not self.play.playing:
            self._draw()

    def _curves(self) -> dict[str, Curves]:
        found = {role: self.session.actors[role].track.curves() for role in ROLES if role in self.session.actors}
        return {role: curves for role, curves in found.items() if curves is not None}

    def _draw(self) -> None:
        self._drawn, curves, opened = time.monotonic(), self._curves(), self.session.opened
        self.folder.visible = bool(curves)
        if not curves or opened is None:
            return
        times = max((found.time for found in curves.values()), key=len)
        now = self._now(curves)
        effort = {role: np.maximum(found.effort, 1.0) for role, found in curves.items()}
        limits = [np.full(len(times), limit) for limit in ENERGY_LIMITS]
        self.effort.data = (times, *_columns(effort, len(times)), *limits, _marked(now, effort, len(times)))
        joint = self._joint(next(iter(curves.values())))
        is_torque = self.quantity.value == TORQUE
        chosen = {role: (found.torque if is_torque else found.power)[:, joint] for role, found in curves.items()}
        most = opened.robot.joints[joint].torque_limit if is_torque else np.nan
        bounds = [np.full(len(times), sign * most) for sign in (1.0, -1.0)]
        largest = max(float(np.abs(values).max()) for values in chosen.values())
        self._show_axis(
            f"{opened.robot.joint_names[joint]}: {self.quantity.value}",
            round_up(max(largest, most if is_torque else 1.0)),
        )
        self.one.data = (times, *_columns(chosen, len(times)), *bounds, _marked(now, chosen, len(times)))

    def _show_axis(self, title: str, reach: float) -> None:
        """Name the lower plot and let it reach from -reach to reach.

        The browser makes a plot anew where either changes, several times a second for who acts live: it then falls
        behind, so nothing is said twice.
        """
        if (title, reach) != self._axis:
            self._axis = title, reach
            self.one.scales = {"x": {"time": False}, "y": {"range": (-reach, reach)}}
            self.one.title = title

    def _joint(self, curves: Curves) -> int:
        """The joint that is chosen; of the one that does most: place of the largest power."""
        opened = self.session.opened
        assert opened is not None
        if self.joint.value in opened.robot.joint_names:
            return opened.robot.joint_names.index(str(self.joint.value))
        return int(np.abs(curves.power).max(0).argmax())

    def _now(self, curves: dict[str, Curves]) -> int:
        """The step of the first role that the moment is at; -1 before any."""
        role, first = next(iter(curves.items()))
        track = self.session.actors[role].track
        return first.until(frame_at(track, self.session.time) / track.fps) - 1


def round_up(value: float) -> float:
    """The next of 1, 1.5, 2, 3, 5, 7, 10 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step for step in (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0) if step * power >= value) * power)


def _columns(values: dict[str, np.ndarray], count: int) -> list[np.ndarray]:
    """A column of `count` numbers for each role, NaN where there is nothing."""
    found = []
    for role in ROLES:
        column = np.full(count, np.nan)
        if role in values:
            column[: len(values[role])] = values[role]
        found.append(column)
    return found


def _marked(now: int, values: dict[str, np.ndarray], count: int) -> np.ndarray:
    """A column with one number, the first role's in step `now`; with none where that is -1."""
    column = np.full(count, np.nan)
    if now >= 0:
        column[now] = next(iter(values.values()))[now]
    return column


def _empty(series: int) -> tuple[np.ndarray, ...]:
    return (np.arange(2.0), *(np.full(2, np.nan) for _ in range(series)))


def _line(label: str, color: str) -> Any:
    return {"label": label, "stroke": color, "width": 1.5, "points": {"show": False}}


def _limit(label: str, color: str) -> Any:
    return {"label": label, "stroke": color, "width": 1, "dash": [5, 4], "points": {"show": False}}


def _now() -> Any:
    return {"label": "now", "stroke": "#111111", "width": 0, "points": {"show": True, "size": 8, "fill": "#111111"}}
