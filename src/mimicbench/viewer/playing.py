"""The panel with the timeline, and the clock behind it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from mimicbench.sim.timing import CONTROL_DT
from mimicbench.viewer.session import Session

PICTURES = 30
"""Per second, at most."""
SPEEDS = ("0.1x", "0.25x", "0.5x", "1x", "2x", "4x")
STEPS = ("|<", "<", ">", ">|")
PLAY, PAUSE = "Play", "Pause"


class PlayPanel:
    """Play, speed, frame step, and a slider over the time."""

    def __init__(self, session: Session) -> None:
        self.session, self.playing = session, False
        self.advance: Callable[[float], None] | None = None
        """Called with a time [s] that is to be shown, before it is: episodes that are not over act on until then."""
        gui, on = session.server.gui, session.safely
        with gui.add_folder("Time", order=2.0):
            self.button = gui.add_button(PLAY, hint="play from here, or from the beginning if it is over")
            self.slider = gui.add_slider("Second", min=0.0, max=1.0, step=CONTROL_DT, initial_value=0.0)
            self.steps = gui.add_button_group("Frame", STEPS)
            self.speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1x")
            self.loop = gui.add_checkbox("Repeat", False)
        self._told = False
        self.button.on_click(on(lambda event: self.play(not self.playing)))
        self.slider.on_update(on(self._slid))
        self.steps.on_click(on(lambda event: self._step(str(event.target.value))))
        session.changed.append(self._refit)
        session.moved.append(self._follow)
        self._stop = threading.Event()
        self._clock = threading.Thread(target=self._run, daemon=True)
        self._clock.start()

    def play(self, playing: bool) -> None:
        """Start or stop."""
        if playing and self._over():
            self.session.show(0.0)
        self.playing = playing
        self.button.label = PAUSE if playing else PLAY

    def close(self) -> None:
        """Stop the clock."""
        self._stop.set()
        self._clock.join(timeout=2.0)

    def _over(self) -> bool:
        return self.session.time >= self.session.duration - 1e-6 and self.session.duration > 0

    def _slid(self, event: object) -> None:
        if not self._told and abs(self.slider.value - self.session.time) > CONTROL_DT / 2:
            self._show(float(self.slider.value))

    def _step(self, step: str) -> None:
        self.play(False)
        place = STEPS.index(step)
        frames = [actor.track.fps for actor in self.session.actors.values()]
        frame = 1 / max(frames, default=1 / CONTROL_DT)
        wanted = (0.0, self.session.time - frame, self.session.time + frame, self.session.duration)[place]
        self._show(wanted)

    def _show(self, wanted: float) -> None:
        if self.advance is not None:
            self.advance(wanted)
        self.session.show(wanted)

    def _refit(self) -> None:
        """The slider goes from 0 to the end of what is there now."""
        self._told = True
        self.slider.max = _ceil(self.session.duration)
        self._told = False
        self._follow()

    def _follow(self) -> None:
        """The slider is where the time is."""
        self._told = True
        if self.session.duration > self.slider.max:
            self.slider.max = _ceil(self.session.duration)
        self.slider.value = min(self.session.time, self.slider.max)
        self._told = False

    def _run(self) -> None:
        last = time.monotonic()
        tick = self.session.safely(self._tick)
        while not self._stop.wait(max(0.0, last + 1 / PICTURES - time.monotonic())):
            now = time.monotonic()
            # a machine that cannot keep up shows all there is, slower
            tick(min(now - last, 0.25))
            last = now

    def _tick(self, passed: float) -> None:
        if not self.playing or not self.session.server.get_clients():
            return
        self._show(self.session.time + passed * float(str(self.speed.value).rstrip("x")))
        if self._over():
            self.play(False)
            if self.loop.value:
                self.play(True)


def _ceil(seconds: float) -> float:
    """The next whole control step, as a number of few digits."""
    return round(max(1, math.ceil(seconds / CONTROL_DT - 1e-6)) * CONTROL_DT, 2)
