"""No generic module names a task, a kind of object, a robot or a method: what knows one is listed here, with why.

And commands that messages advise can be typed as they stand.
"""

import ast
import re
from pathlib import Path

import pytest

from mimicbench.imitate.registry import LEARNERS
from mimicbench.objects.registry import FAMILIES
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS

SOURCE = Path(__file__).parents[1] / "src" / "mimicbench"
ITEMS = {name for registry in (TASKS, FAMILIES, ROBOTS, TRACKERS, LEARNERS, METHODS) for name in registry}
WORDS = {
    "sit",
    "lie",
    "chair",
    "sofa",
    "couch",
    "bed",
    "berth",
    "seat",
    "h1",
    "g1",
    "unitree",
    "hst",
    "planner",
    "omnih2o",
}
"""Words of identifiers. `box` is none: all objects are made of boxes."""
LABELS = {"seat_height", "seat_polygon", "require_seat", "requires_seat"}
"""What objects, of any family, are labeled with for those who judge; no sensor sees it."""
MAY = {
    "tasks/": "one file a task, and the goals that some share",
    "objects/families/": "one file a family, and their parts",
    "objects/importing/": "what meshes of each kind of furniture look like",
    "robots/g1.py": "the robot",
    "robots/h1.py": "the robot",
    "robots/people.py": "what bears a person who sits",
    "references/": "what people do with each kind of object: one file a task in synthesis, and what these are made of",
    "retarget/methods/": "one file a method",
    "track/trackers/": "one file a tracker",
    "imitate/learners/": "one file a learner",
    "imitate/networks/": "one file a learner's network",
    "imitate/online/": "the learner `online`: how it plans, and acts",
    "imitate/planner.py": "the learner `planner`: its network, of which learners/planner.py is the row",
    "imitate/learn_planner.py": "and its training",
    "policies/act.py": "one file a kind of policy",
    "policies/bc.py": "the same",
    "policies/diffusion.py": "the same",
    "policies/hit.py": "the same",
    "policies/online.py": "the same",
    "policies/planner.py": "the same",
    "policies/ppo.py": "the same",
    "benchmark/presets.py": "named recipes",
    "comparisons/": "one file a comparison of methods",
    "report/paper_tables.py": "the paper's numbers, by its tasks and methods",
    "report/person.py": "the drawn person's trousers are called after what is sat on",
    "objects/registry.py": "order of the names",
    "retarget/registry.py": "order of the names, and the default",
    "robots/registry.py": "the default",
    "track/registry.py": "order of the names",
    "imitate/registry.py": "order of the names",
    "imitate/spec.py": "the default learner",
    "track/settings.py": "the default tracker",
    "imitate/dagger.py": "the learner `planner`: the episodes that it learns from",
    "__init__.py": "Gymnasium's names of the environments, known without an import",
}
"""Files and folders that name what they are about."""
MEANS_ELSE = {
    "envs/episodes.py": {"residual"},  # an action of environments: angles around the rest pose
    "envs/spaces.py": {"residual"},
    "evaluate/guard.py": {"act"},  # the method of a policy
    "policies/loading.py": {"act"},
    "track/train.py": {"ppo"},  # a part of the training's state
    "retarget/samples.py": {"box"},  # the type of a shape
    "retarget/self_contact.py": {"box"},
}


def documented(tree):
    """Constants that are docstrings, of modules, classes, functions and fields."""
    bodies = [node.body for node in ast.walk(tree) if isinstance(getattr(node, "body", None), list)]
    return {id(one.value) for body in bodies for one in body if isinstance(one, ast.Expr)}


def names_in(source):
    """Items and words that a module names outside of its docstrings."""
    tree = ast.parse(source)
    docs, found = documented(tree), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            found |= {item for item in ITEMS if node.value == item or ("-" in item and item in node.value)}
            found |= {"h1", "g1"} & set(re.split(r"\W+", node.value.lower()))
        for field in ("id", "attr", "name", "arg", "module"):
            name = getattr(node, field, None)
            if isinstance(name, str) and name not in LABELS:
                parts = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()
                found |= WORDS & {word.removesuffix("s") for word in re.split(r"[_.]", parts)}
    return found


def generic_modules():
    """(name, path) of every module without an exception, and of those that are of every task."""
    for path in sorted(SOURCE.rglob("*.py")):
        name = path.relative_to(SOURCE).as_posix()
        special = any(name == place or (place.endswith("/") and name.startswith(place)) for place in MAY)
        if not special or name in ("tasks/task.py", "tasks/goal.py"):
            yield name, path


def test_generic_modules_name_nothing():
    found = {name: names_in(path.read_text()) - MEANS_ELSE.get(name, set()) for name, path in generic_modules()}
    assert not {name: sorted(words) for name, words in found.items() if words}


def test_every_exception_is_needed():
    assert not [place for place in MAY if not (SOURCE / place).exists()]
    for place in MAY:
        paths = sorted((SOURCE / place).rglob("*.py")) if place.endswith("/") else [SOURCE / place]
        assert any(names_in(path.read_text()) for path in paths), f"{place} names nothing any more: take it away"
    for name, words in MEANS_ELSE.items():
        assert words <= names_in((SOURCE / name).read_text()), f"{name} does not name {words}"


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ('if task.name == "sit-chair": pass', {"sit-chair"}),
        ('say(f"more lift-box clips of {robot}")', {"lift-box"}),
        ("def nearestSeat(bed_frames): pass", {"seat", "bed"}),
        ("from mimicbench.robots.h1 import ROBOT", {"h1"}),
        ('"""Of a seat."""\nheight = obj.seat_height\nname = "chairman"', set()),
        ("elements = sitter + lied", set()),
    ],
)
def test_names_are_found(source, found):
    assert names_in(source) == found


def test_commands_that_are_advised_can_be_typed():
    """Whoever is told to run a command with a workdir gets it in quotes where it has blanks."""
    advice = [
        (path.name, found)
        for path in SOURCE.rglob("*.py")
        for found in re.findall(r"--workdir \{(\w+)", path.read_text("utf-8"))
    ]
    assert len(advice) > 5
    assert {what for _, what in advice} == {"typed"}, advice
