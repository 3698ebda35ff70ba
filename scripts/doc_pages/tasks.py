"""Pages of tasks and of what can be observed at them."""

import math
import re
import sys

from doc_pages.words import defined_in, summary, table
from mimicbench import ENVIRONMENTS
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import TERMS
from mimicbench.sensors.term import WORDS, Term
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task


def tasks_page() -> str:
    """All tasks in one table."""
    rows = (
        (f"[{t.name}]({t.name}.md)", t.abbreviation, t.title, family(t), f"{t.time_limit:g} s") for t in TASKS.all()
    )
    return "# Tasks\n\n" + table(("task", "paper", "what", "objects", "time limit"), rows)


def task_page(task: Task, robot: Robot) -> str:
    """One task: what is asked, what is seen."""
    name = environment(task)
    when = "in the last frame" if task.in_last_frame else f"for {task.hold_time:g} s without a break, at any time"
    start = "anywhere" if task.max_start_distance is None else f"at most {task.max_start_distance:g} m from the object"
    facts = [
        ("abbreviation in the paper", task.abbreviation),
        ("Gymnasium environment", f"`{name}`"),
        ("objects", family(task)),
        ("time limit", f"{task.time_limit:g} s"),
        ("K is judged", when),
        ("starts of clips", start),
        ("cell of the elevation map", f"{100 * task.map_cell:g} cm"),
    ]
    holds = re.sub(r"^\(N,\) whether ", "", summary(task.holds.__doc__))
    missing = "\n".join(f"- {part.words.format('so much')}" for part in task.shortfalls)
    goal = "it is told" if task.goal.given else "it has to find by its own senses"
    asked = (
        f"In a frame, K's condition asks whether {holds}\n\nWhat the report says of who misses it:\n\n{missing}\n\n"
        "To the letter: [definitions](../definitions.md)."
    )
    named = table(("part", "kind"), ((f.name, f.kind) for f in task.goal.fields))
    mounts = ((m.name, *(f"{math.degrees(a):.0f}°" for a in (m.bearing, m.pitch)), m.height) for m in task.rig.mounts)
    cameras = table(("camera", "faces (counter-clockwise)", "looks down", "above the root [m]"), mounts)
    what = summary(sys.modules[defined_in(TASKS, task.name)].__doc__)
    parts = [
        f"# {task.name}",
        what,
        table(("", ""), facts),
        f"## Success: K\n\n{asked}",
        f"## The goal\n\nWhat {goal}:\n\n{named}",
        f"## Observations\n\nFor the robot `{robot.name}`. [What each is](../methods/observations.md).\n\n"
        + observations(task, robot),
        f"## Cameras\n\nRig `{task.rig.name}`, {math.degrees(task.rig.field_of_view):.0f}° wide each.\n\n{cameras}",
        f'## Try it\n\n```python\nimport gymnasium, mimicbench\n\nenv = gymnasium.make("{name}")\n```',
    ]
    return "\n\n".join(parts)


def observations(task: Task, robot: Robot) -> str:
    """The terms that a task has."""
    rows = ((f"`{t.name}`", shape(t, robot, task), privileged(t)) for t in TERMS.values() if t.exists(task))
    return table(("term", "shape", "who may use it"), rows)


def observations_page(robot: Robot) -> str:
    """All terms, with the tasks that have them."""
    return (
        "# Observation terms\n\nPolicies, trackers and environments ask for them by name. Shapes are those of the "
        f"robot `{robot.name}`; `height` and `width` are chosen. How the senses work: [senses](../senses.md).\n\n"
        + terms_table(robot)
    )


def terms_table(robot: Robot) -> str:
    """All terms, those that any policy may use first."""
    tasks = TASKS.all()
    rows = []
    for term in sorted(TERMS.values(), key=lambda term: term.privileged):
        having = [task for task in tasks if term.exists(task)]
        where = "all" if len(having) == len(tasks) else ", ".join(task.name for task in having)
        shapes = dict.fromkeys(shape(term, robot, task) for task in having)
        rows.append((f"`{term.name}`", WORDS[term.name], " or ".join(shapes), privileged(term), where))
    return table(("term", "what", "shape", "who may use it", "tasks"), rows)


def environment(task: Task) -> str:
    """The id of a task's Gymnasium environment."""
    known = {slug: name for name, slug in ENVIRONMENTS.items()}
    return f"mimicbench/{known.get(task.name) or ''.join(word.capitalize() for word in task.name.split('-'))}-v0"


def family(task: Task) -> str:
    """What a task is done with."""
    return f"{task.family}, {'movable' if task.moves_object else 'fixed'}"


def privileged(term: Term) -> str:
    """Who may use a term."""
    return "privileged" if term.privileged else "any policy"


def shape(term: Term, robot: Robot, task: Task) -> str:
    """Such as `(4, height, width)`."""
    free = iter(("height", "width"))
    return f"({', '.join(next(free) if size < 0 else str(size) for size in term.shape(robot, task))})"
