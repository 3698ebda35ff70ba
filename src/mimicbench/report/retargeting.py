"""The ways to retarget side by side: tables of what they measure, the paper's ordering checked, pictures of one clip
by each.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

import numpy as np

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import write_atomic
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.drawing.camera import Picture, frame_all
from mimicbench.evaluate.intervals import Rate
from mimicbench.objects.shape import SceneObject
from mimicbench.report import page
from mimicbench.report.paper_tables import CITATION, RANKING, TABLES
from mimicbench.report.pictures.showcase import moments, positions
from mimicbench.report.render import human_frames, robot_frames
from mimicbench.report.table import Cell, Reported, Table, to_csv, to_markdown
from mimicbench.report.video import stacked, strip, write_jpeg
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model

STILL = Picture(320, 300, 1024)
MOMENTS = 5

# name -> (title, factor, unit)
_SHOWN = {
    "position_error": ("Followed points off", 100, "cm"),
    "wrist_error": ("Wrists off", 100, "cm"),
    "pelvis_error": ("Pelvis off", 100, "cm"),
    "ankle_error": ("Ankles off", 100, "cm"),
    "orientation_error": ("Limbs turned off", 180 / np.pi, "deg"),
    "limit_violation": ("Beyond joint limits", 180 / np.pi, "deg"),
    "velocity_ratio": ("Fastest joint, of its limit", 100, "%"),
    "acceleration": ("Joint acceleration", 1, "rad/s²"),
    "skate": ("Standing feet move", 100, "cm/s"),
    "step_skate": ("Skating", 100, "cm per step"),
    "sole_height": ("Standing soles off the floor", 100, "cm"),
    "sole_depth": ("Soles in the floor, deepest", 100, "cm"),
    "sole_tilt": ("Standing soles tilted", 180 / np.pi, "deg"),
    "penetration": ("Frames more than 1 cm in something", 100, "%"),
    "depth": ("Deepest", 100, "cm"),
    "goal_error": ("Wrists from their goals", 100, "cm"),
    "contact_kept": ("Contact kept", 100, "%"),
    "balance": ("Center of mass off the feet", 100, "cm"),
    "self_collision": ("Frames in itself", 100, "%"),
    "support_lost": ("Rest without contact", 100, "% of the time"),
    "lean_error": ("Resting trunk off", 180 / np.pi, "deg"),
}


@dataclass(frozen=True)
class MethodResult:
    """One method on the clips of one task."""

    task: str
    method: str
    preset: str
    summary: Mapping
    """Of the stage (retarget.verdict.Summary)."""
    frames_per_second: float
    """Of one core, measured on the first clip."""

    def mean(self, name: str) -> float | None:
        """Mean of a measure, in the unit that it is shown in."""
        told = self.summary["measures"].get(name)
        return None if told is None else float(told["mean"]) * _SHOWN[name][1]

    def worst(self, name: str) -> float | None:
        """The worst clip's."""
        told = self.summary["measures"].get(name)
        return None if told is None else float(told["worst"]) * _SHOWN[name][1]


@dataclass(frozen=True)
class Comparison:
    """All methods on all compared tasks."""

    results: tuple[MethodResult, ...]

    def to_dict(self) -> dict[str, object]:
        """As plain JSON values."""
        return {"results": [asdict(found) for found in self.results], "ordering": self.ordering()}

    def tables(self) -> tuple[Table, ...]:
        """Places, scene, ordering."""
        return self._places(), self._scene(), self._ordered()

    def ordering(self) -> dict[str, dict[str, tuple[bool, bool]]]:
        """Task -> measure -> whether optimization is better than omnih2o, and omnih2o than copy-rotation.

        As good is enough for the rate of K.
        """
        found = {}
        for task in dict.fromkeys(result.task for result in self.results):
            by_name = {result.method: result for result in self.results if result.task == task}
            if not all(name in by_name for name in RANKING):
                continue
            first, second, third = (by_name[name] for name in RANKING)
            found[task] = {}
            for what in ("wrist_error", "pelvis_error", "position_error"):
                errors = [result.mean(what) or 0.0 for result in (first, second, third)]
                found[task][what.removesuffix("_error")] = (errors[0] < errors[1], errors[1] < errors[2])
            kept = [result.summary["fulfilled"] for result in (first, second, third)]
            found[task]["k"] = (kept[0] >= kept[1], kept[1] >= kept[2])
        return found

    def _places(self) -> Table:
        rows: list[tuple[Cell, ...]] = []
        for r in self.results:
            told = r.summary
            theirs = _published(r.task, METHODS.get(r.method).title)
            rows.append(
                (
                    r.task,
                    METHODS.get(r.method).title,
                    Rate(told["fulfilled"], told["clips"]),
                    Rate(told["kept"], told["clips"]),
                    _digits(r.mean("wrist_error")),
                    _digits(r.mean("pelvis_error")),
                    _digits(r.mean("position_error")),
                    _digits(r.mean("orientation_error")),
                    theirs,
                    round(r.frames_per_second),
                )
            )
        columns = (
            "Task",
            "Method",
            "K",
            "Kept",
            "Wrists off [cm]",
            "Pelvis off [cm]",
            "Followed points off [cm]",
            "Limbs turned off [deg]",
            "K after tracking, paper",
            "Frames/s of a core",
        )
        note = (
            "Means over clips. Wrists and pelvis: distance of the robot's wrist keypoints and root "
            "from the human's own wrist and pelvis joints, "
            "without the shifts of `improved`, after the robot was put on the floor. K: with 95 % Wilson intervals. "
            "Kept: K holds and no measure is beyond its limit."
        )
        return Table("retargeting-places", "Where the methods put the body", columns, tuple(rows), note, CITATION)

    def _scene(self) -> Table:
        rows = tuple(
            (
                r.task,
                METHODS.get(r.method).title,
                _digits(r.mean("penetration")),
                _digits(r.worst("depth")),
                _digits(r.mean("contact_kept")),
                _digits(r.mean("step_skate"), 2),
                _digits(r.mean("balance")),
                _digits(r.worst("velocity_ratio"), 0),
                _digits(r.mean("acceleration"), 1),
                _digits(r.mean("self_collision")),
                _digits(r.worst("limit_violation"), 2),
            )
            for r in self.results
        )
        columns = (
            "Task",
            "Method",
            "Frames > 1 cm in something [%]",
            "Deepest [cm]",
            "Contact kept [%]",
            "Skating [cm per step]",
            "Center of mass off the feet [cm]",
            "Fastest joint [% of limit]",
            "Joint acceleration [rad/s²]",
            "Frames in itself [%]",
            "Beyond limits [deg]",
        )
        return Table(
            "retargeting-scene",
            "What the robot does with the scene",
            columns,
            rows,
            "Means over clips; deepest, fastest and beyond limits: of the worst clip.",
        )

    def _ordered(self) -> Table:
        rows = tuple(
            (task, *(", ".join("yes" if holds else "no" for holds in both) for both in found.values()))
            for task, found in self.ordering().items()
        )
        title = "Is optimization better than OmniH2O, and OmniH2O better than copy rotation?"
        note = "By the means of the table of places; K: by the number of clips, and as good is enough."
        return Table("retargeting-ordering", title, ("Task", "Wrists", "Pelvis", "Followed points", "K"), rows, note)


def measures_table(task: str, measures: Mapping[str, Mapping[str, float]]) -> Table:
    """Mean and worst of every measure of one set of clips, as retarget.verdict.Summary has them."""
    rows = tuple(
        (title, unit, f"{told['mean'] * factor:.3g}", f"{told['worst'] * factor:.3g}")
        for name, (title, factor, unit) in _SHOWN.items()
        if (told := measures.get(name))
    )
    return Table("retargeting", f"Retargeted clips of {task}", ("Measure", "Unit", "Mean", "Worst clip"), rows)


@dataclass(frozen=True)
class SideBySide:
    """One human clip, and robot motions made of it."""

    obj: SceneObject
    human: HumanMotion
    robots: Mapping[str, RobotMotion]
    """By what is written beside them."""

    def caption(self) -> str:
        """One sentence under the picture."""
        return f"{self.human.id} on {self.obj.id} ({self.obj.kind}): from the top the human, {', '.join(self.robots)}."


def draw_side_by_side(sides: SideBySide, count: int = MOMENTS, still: Picture = STILL) -> np.ndarray:
    """One picture (H, W, 3): the human's moments in the first row, each robot motion's at the same times below.

    Raises NoPictures without OpenGL.
    """
    obj, human, robots = sides.obj, sides.human, sides.robots
    first = next(iter(robots.values()), None)
    if first is None:
        raise MimicbenchError("there is no robot motion to draw")
    model = build_model(ROBOTS.get(first.robot), obj, visuals=True)
    paths = np.concatenate([human.root_pos_w, *(motion.root_pos_w for motion in robots.values())])
    camera = frame_all(obj, paths, still.width / still.height)
    frames = moments(human.root_pos_w, human.local_quat[:, 0], count)
    frames[-1] = human.frames - 1
    times = frames / human.fps
    rows = [strip(list(human_frames(model, human, times, camera, still)), [f"human, {time:.1f} s" for time in times])]
    for title, motion in robots.items():
        index = np.clip(np.round(times * motion.fps).astype(int), 0, motion.frames - 1)
        drawn = list(robot_frames(model, positions(motion, model)[index], camera, still, motion.wrist_goal_w))
        rows.append(strip(drawn, [title, *[""] * (count - 1)]))
    return stacked(rows)


def write_comparison(folder: Path, found: Comparison, pictures: Mapping[str, tuple[str, np.ndarray]]) -> Path:
    """Write `index.html`, the tables as Markdown and CSV, and the pictures of each task (caption, picture) as JPEG.

    Return the page's path.
    """
    for data in found.tables():
        for suffix, write in (("md", to_markdown), ("csv", to_csv)):
            _write(folder / f"{data.name}.{suffix}", write(data))
    shown = []
    for task, (caption, picture) in pictures.items():
        write_jpeg(folder / f"retargeting-{task}.jpg", picture, 82)
        shown.append(page.stage(task, caption, folder / f"retargeting-{task}.jpg"))
    sections = [page.Section(data.title, page.table(data)) for data in found.tables()]
    sections += [page.Section("The same clip by every method", page.joined(shown))] if shown else []
    names = ", ".join(dict.fromkeys(METHODS.get(result.method).title for result in found.results))
    text = page.page(
        "From people to the robot",
        "mimicbench · retargeting",
        f"The same clips by every method: {names}.",
        (),
        sections,
        "Written by mimicbench.",
    )
    _write(folder / "index.html", text)
    return folder / "index.html"


def _published(task: str, title: str) -> Reported | None:
    """K of the paper's tracker on clips by this method, if it tells."""
    for data in TABLES:
        if data.label == "tab:retargeting_comparison" and data.measures == "tracking":
            for name, rates in data.rates.items():
                if name.lower().replace("-", " ") == title.lower() and task in rates:
                    return Reported(rates[task].kinematic)
    return None


def _digits(value: float | None, digits: int = 1) -> float | None:
    return None if value is None else round(value, digits)


def _write(path: Path, words: str) -> None:
    def write(stream: IO[bytes]) -> None:
        stream.write(words.encode())

    write_atomic(path, write)
