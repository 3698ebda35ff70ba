"""Measures the tables of docs/people.md and docs/people-judged.md: `python scripts/measure_people.py [folder ...]`.

Synthetic clips are made on the spot. The folders are of real recordings, the first UniHSI's `motion_clips`; people of
further ones are told from ours, too. Without recordings their columns and tables stay as they are in the file.
"""

import sys
from pathlib import Path

import numpy as np

from mimicbench.core.motion import HumanMotion
from mimicbench.objects.registry import FAMILIES
from mimicbench.references.body.body import body_of, unihsi_body
from mimicbench.references.checks.beside_real import judge, person_of, read_recordings
from mimicbench.references.checks.gait_measures import measure_gait, summarize, walking_model
from mimicbench.references.checks.quality import gate
from mimicbench.references.importers.unihsi import import_skeleton_motion
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.straight import clip_of_walk, straight_way
from mimicbench.references.paper import PAPER_SETS
from mimicbench.references.recordings.real_clips import sitting_clips
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.report.beside_real import features_table, judgement_table, measures_table
from mimicbench.report.table import Cell, Table, to_markdown
from mimicbench.tasks.registry import TASKS

PAGES = [Path(__file__).parents[1] / "docs" / name for name in ("people.md", "people-judged.md")]
CLIPS = 100
"""Synthetic clips per task."""
JUDGED = 40
"""Of these told from real people."""
SITTING = ("armchair", "armchair002", "chair_mo001", "chair_mo012")
WALKING = (*SITTING, "lie_down", "lie_down_2", "lie_down_10")

Summary = dict[str, tuple[float, float, int]]

PUBLISHED = {
    "speed": "1.3",
    "cadence": "105-115",
    "double_support": "20",
    "hip_range": "40-45",
    "knee_range": "55-60",
    "ankle_range": "25-30",
    "walking_lean": "3-7",
    "sit_time": "2.0-2.8, with the lean before",
    "sit_lean": "35-45",
    "sit_hip": "about 110",
    "seated_knee": "90-100",
}
"""Of healthy adults at their usual speed; the sources are named below the table."""
ROWS = {
    "speed": ("walking speed [m/s]", 1.0, 2),
    "cadence": ("cadence [steps/min]", 1.0, 0),
    "step_length": ("step length [cm]", 100.0, 0),
    "step_width": ("step width [cm]", 100.0, 0),
    "double_support": ("double support [% of the time]", 100.0, 0),
    "hip_range": ("hip range, walking [deg]", 1.0, 0),
    "knee_range": ("knee range, walking [deg]", 1.0, 0),
    "ankle_range": ("ankle range, walking [deg]", 1.0, 0),
    "straighter_knee": ("the straighter knee, walking, median [deg]", 1.0, 0),
    "pelvis_rise": ("rise of the pelvis in a step [cm]", 100.0, 1),
    "walking_lean": ("trunk lean, walking [deg]", 1.0, 0),
    "sit_time": ("sit-down time, 5 to 95 % of the way [s]", 1.0, 2),
    "sit_speed": ("fastest sinking [m/s]", 1.0, 2),
    "sit_lean": ("largest trunk lean, sitting down [deg]", 1.0, 0),
    "sit_hip": ("largest hip flexion, sitting down [deg]", 1.0, 0),
    "seated_knee": ("knee flexion, seated [deg]", 1.0, 0),
}
"""Measure -> its words, factor and digits."""


def main() -> None:
    """Measure, and write the tables into the page."""
    clips = {task: synthetic(task) for task in TASKS}
    columns: dict[str, Summary] = {
        PAPER_SETS[task].abbreviation: summarize(map(measure_gait, found)) for task, found in clips.items()
    }
    walkers = [motion for task in ("sit-chair", "sit-sofa", "lie-bed", "lie-sofa") for motion in clips[task]]
    leg = float(np.mean([sum(body_of(motion.skeleton).length(body_of(motion.skeleton).legs[0])) for motion in walkers]))
    speed = float(np.mean([columns[name]["speed"][0] for name in ("SC", "SS", "LB", "LS")]))
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        sitting = [
            measure_gait(motion)
            for name in SITTING
            for motion, _ in sitting_clips(import_skeleton_motion(folder / f"{name}.npy"), "sit-chair")
        ]
        to_seats, seats = summarize(measure_gait(whole(folder / f"{name}.npy")) for name in WALKING), summarize(sitting)
        columns["real, to a seat or bed"] = to_seats | {
            name: value for name, value in seats.items() if name.startswith(("sit_", "seated"))
        }
        columns["real, walking about"] = summarize([measure_gait(whole(folder / "locomotion_random.npy"))])
    columns = {name: found for name, found in columns.items() if any(count for _, _, count in found.values())}
    model = walking_model(speed, leg)
    rows: list[tuple[Cell, ...]] = []
    for name, (words, factor, digits) in ROWS.items():
        cells = [written(found[name], factor, digits) for found in columns.values()]
        at_speed = (
            f"{speed:.2f}" if name == "speed" else f"{factor * model[name]:.{digits}f}" if name in model else None
        )
        rows.append((words, *cells, at_speed, PUBLISHED.get(name)))
    table = Table(
        "people",
        f"Synthetic and real people, {CLIPS} clips per task",
        ("", *columns, "people at our speed", "published"),
        tuple(rows),
    )
    put("measured", to_markdown(table))
    if len(sys.argv) > 1:
        real = [person_of(motion) for folder in sys.argv[1:] for motion in read_recordings(Path(folder), print)]
        people = {task: [person_of(motion) for motion in found[:JUDGED]] for task, found in clips.items()}
        judged = judge(real, [person for found in people.values() for person in found])
        ahead = {"5 m straight ahead": [person_of(motion) for motion in walks_ahead()]}
        tables = judgement_table(judged), measures_table(real, ahead | people), features_table(judged)
        put("judge", "\n".join(map(to_markdown, tables)))


def put(name: str, words: str) -> None:
    """Write between two marks of the page that has them."""
    begin, end = f"<!-- {name}: begin -->\n", f"<!-- {name}: end -->"
    page = next(page for page in PAGES if begin in page.read_text())
    text = page.read_text()
    page.write_text(text[: text.index(begin) + len(begin)] + "\n" + words + "\n" + text[text.index(end) :])


def synthetic(task: str) -> list[HumanMotion]:
    """Good clips of a task, each on an object of its own."""
    found, index = [], 0
    while len(found) < CLIPS:
        obj = FAMILIES.get(TASKS.get(task).family).make(index, 0)
        motion = synthesize(task, index, obj, 0)
        if not gate(motion, obj, TASKS.get(task).fulfilled_by_human):
            found.append(motion)
        index += 1
    return found


def walks_ahead() -> list[HumanMotion]:
    """People of several sizes who walk at several speeds: the gait, where it has the room that recordings have."""
    return [
        clip_of_walk(body, straight_way(body, Gait(speed=speed), 5.0))
        for body in map(unihsi_body, (1.04, 1.08, 1.12))
        for speed in (0.65, 0.75, 0.85)
    ]


def whole(path: Path) -> HumanMotion:
    """A recording as it is, beside no object."""
    recording = import_skeleton_motion(path)
    return HumanMotion(
        recording.name, "walk", recording.skeleton, recording.fps, recording.root_pos_w, recording.local_quat, "none"
    )


def written(value: tuple[float, float, int], factor: float, digits: int) -> str | None:
    """Mean and deviation; nothing where there are too few clips to tell."""
    mean, deviation, count = value
    if count == 0:
        return None
    return f"{round(factor * mean, digits) + 0.0:.{digits}f}" + (
        f" ± {factor * deviation:.{digits}f}" if count > 1 else ""
    )


if __name__ == "__main__":
    main()
