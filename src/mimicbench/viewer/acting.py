"""The panel in which trackers and policies act, side by side if wanted, and are pushed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.viewer.live import Episode
from mimicbench.viewer.methods import methods, named, whose
from mimicbench.viewer.playing import PlayPanel
from mimicbench.viewer.session import Session

NOBODY: str = "nobody"
PUSHES = {"Forward": (1.0, 0.0), "Back": (-1.0, 0.0), "Left": (0.0, 1.0), "Right": (0.0, -1.0)}
"""Directions as the robot sees them."""
ROLES = ("robot", "other")


class ActPanel:
    """Who acts, and what is done to them."""

    def __init__(self, session: Session, play: PlayPanel, workdir: Path, policies: tuple[str, ...] = ()) -> None:
        """`policies` are paths of further checkpoints, Python and ONNX files: the page itself cannot name any."""
        self.session, self.play, self.workdir, self.policies = session, play, workdir, policies
        self.episodes: dict[str, Episode] = {}
        """By role."""
        self.folders: dict[str, Path] = {}
        gui, on = session.server.gui, session.safely
        with gui.add_folder("Act", order=4.0):
            self.who = {
                "robot": gui.add_dropdown("Method", [NOBODY], hint="follows the clip, or begins where it begins"),
                "other": gui.add_dropdown("Compare with", [NOBODY]),
            }
            self.beside = gui.add_checkbox("Side by side", True)
            self.button = gui.add_button("Act", hint="from the beginning")
            self.strength = gui.add_slider("Push [m/s]", min=0.1, max=2.0, step=0.1, initial_value=0.6)
            self.pushes = gui.add_button_group("Push", tuple(PUSHES))
        self.button.on_click(on(lambda event: self.begin()))
        self.beside.on_update(on(lambda event: session.apart("other", self.beside.value)))
        self.pushes.on_click(on(lambda event: self.push(str(event.target.value))))
        play.advance = self._advance
        session.opening.append(self._opened)

    def begin(self) -> None:
        """Whoever is chosen begins anew, and the time runs."""
        opened = self.session.opened
        if opened is None:
            raise MimicbenchError("nothing is shown that anybody could act beside: choose an item first")
        self._end()
        chosen = {role: str(box.value) for role, box in self.who.items() if box.value in self.folders}
        if not chosen:
            raise MimicbenchError("choose a method first: a tracker that follows the clip, or a policy")
        self.session.time, self.session.horizon = 0.0, opened.task.time_limit
        for role, name in chosen.items():
            self.episodes[role] = Episode(name, self.folders[name], opened)
            self.session.enter(role, self.episodes[role].track)
        self.session.apart("other", self.beside.value)
        self.session.tell_changed()
        self.session.show(0.0)
        self.play.play(True)

    def push(self, direction: str) -> None:
        """Push everybody who acts, where they are now."""
        if not any(not episode.over for episode in self.episodes.values()):
            raise MimicbenchError("nobody acts now who could be pushed: press Act first")
        for episode in self.episodes.values():
            if episode.over:
                continue
            pose = episode.track.poses[-1]
            ahead = np.array([*PUSHES[direction], 0.0]) * float(self.strength.value)
            episode.push(rot.rotate(rot.from_yaw(rot.yaw_of(pose.quat_w[0])), ahead))
        # what comes of it begins where they are now
        self.session.show(max(len(episode.track) - 1 for episode in self.episodes.values()) * CONTROL_DT)
        self.play.play(True)

    def _advance(self, time: float) -> None:
        for episode in self.episodes.values():
            episode.until(time)

    def _end(self) -> None:
        for role, episode in self.episodes.items():
            episode.close()
            self.session.leave(role)
        self.episodes.clear()

    def _opened(self) -> None:
        """Another item: other methods can act. Without any, who was chosen is kept for the next."""
        opened = self.session.opened
        for episode in self.episodes.values():
            episode.close()
        self.episodes.clear()
        self.play.play(False)
        self.folders = {}
        if opened is None:
            return
        if opened.clip is not None:
            self.folders = methods(opened.task.name, opened.robot.name, self.workdir)
            self.folders |= named(self.policies, self.folders)
        names = (NOBODY, *self.folders)
        for box in self.who.values():
            before = str(box.value)
            box.options = names
            box.value = before if before in names else NOBODY
        if (acted := whose(self.folders, opened)) is not None:
            self.who["robot"].value = acted
