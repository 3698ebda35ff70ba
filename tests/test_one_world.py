"""Physics is stepped in one place: who learns or judges does so through `envs.vec_env`, and `sim` alone has engines."""

import ast
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "mimicbench"
STEPS = {"mj_step", "mj_step1", "mj_step2"}
"""What moves a world in MuJoCo."""
ENGINES = ("mujoco.batch", "mujoco.rollout", "mujoco_warp")
"""And what moves many."""
WORLDS = {"make_physics", "NativePhysics", "WarpPhysics"}
"""What makes many of them."""


def called(source: str) -> tuple[set[str], set[str]]:
    """The names of what is called, and of what methods of something named `physics` are."""
    names, methods = set(), set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Attribute):
                names.add(node.func.attr)
                owner = node.func.value
                owner_name = owner.attr if isinstance(owner, ast.Attribute) else getattr(owner, "id", "")
                if "physics" in owner_name.lower():
                    methods.add(node.func.attr)
            elif isinstance(node.func, ast.Name):
                names.add(node.func.id)
    return names, methods


def runs_one(name: str) -> bool:
    """Whether a module imports an engine."""
    nodes = list(ast.walk(ast.parse((SOURCE / name).read_text())))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    given = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return any(module.startswith(ENGINES) for module in plain | given)


def modules():
    for path in sorted(SOURCE.rglob("*.py")):
        yield path.relative_to(SOURCE).as_posix(), *called(path.read_text())


def test_nobody_but_the_environment_steps_physics():
    steppers = {name for name, _, methods in modules() if "step" in methods}
    assert steppers == {"envs/vec_env.py"}


def test_nobody_but_the_environment_and_who_measures_makes_worlds():
    makers = {name for name, names, _ in modules() if names & WORLDS and not name.startswith(("sim/", "bench/"))}
    assert makers == {"envs/vec_env.py"}


def test_engines_are_known_to_sim_and_to_who_measures_them():
    users = {name for name, names, _ in modules() if names & STEPS}
    users |= {name for name, _, _ in modules() if runs_one(name)}
    assert "sim/native.py" in users and all(name.startswith(("sim/", "bench/")) for name in users)


@pytest.mark.parametrize(
    ("source", "names", "methods"),
    [
        ("self.physics.step(action)", {"step"}, {"step"}),
        ("own_physics.step(action)", {"step"}, {"step"}),
        ("optimizer.step()", {"step"}, set()),
        ("mujoco.mj_step(model, data)", {"mj_step"}, set()),
        ("make_physics('cpu', robot, objects)", {"make_physics"}, set()),
    ],
)
def test_steps_are_found(source, names, methods):
    assert called(source) == (names, methods)
