"""Humanoid-scene interaction learned by mimicking humans: benchmark and toolkit.

Importing it makes the environments known to Gymnasium: `gymnasium.make("mimicbench/SitChair-v0")`. Importing Gymnasium
takes 0.1 s, so that is not done here; the environments are made known as soon as somebody else does it.
"""

import sys
from importlib.machinery import ModuleSpec
from types import ModuleType

__version__ = "0.2.0.dev0"

ENVIRONMENTS = {
    "SitChair": "sit-chair",
    "SitSofa": "sit-sofa",
    "LieBed": "lie-bed",
    "LieSofa": "lie-sofa",
    "TouchPoints": "touch-points",
    "LiftBox": "lift-box",
}
"""Names of the environments, each with its task's; their ids are `mimicbench/<name>-v0`."""
EPISODE_STEPS = {name: 500 if task in ("touch-points", "lift-box") else 1000 for name, task in ENVIRONMENTS.items()}
"""Control steps of 0.02 s in the time limits of their tasks, known without importing these."""


def register_environments(gymnasium: ModuleType) -> None:
    """Tell Gymnasium, the module, where its `make` and `make_vec` find the environments, other packages' included."""
    from importlib.metadata import entry_points

    for name, task in ENVIRONMENTS.items():
        gymnasium.register(
            f"mimicbench/{name}-v0",
            "mimicbench.envs.gym:TaskEnv",
            vector_entry_point="mimicbench.envs.gym_vector:TaskVectorEnv",
            max_episode_steps=EPISODE_STEPS[name],
            kwargs={"task": task},
        )
    for task in (point.name for point in entry_points(group="mimicbench.tasks")):  # their time limits are not known yet
        gymnasium.register(
            f"mimicbench/{''.join(word.capitalize() for word in task.split('-'))}-v0",
            "mimicbench.envs.gym:TaskEnv",
            vector_entry_point="mimicbench.envs.gym_vector:TaskVectorEnv",
            kwargs={"task": task},
        )


class _WhenGymnasiumComes:
    """A finder on `sys.meta_path` that finds Gymnasium the usual way, once, and has the environments registered
    after its import.
    """

    def find_spec(self, name: str, path: object = None, target: ModuleType | None = None) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        from importlib.util import find_spec

        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            run = spec.loader.exec_module

            def run_and_register(module: ModuleType) -> None:
                run(module)
                register_environments(module)

            spec.loader.exec_module = run_and_register  # type: ignore[method-assign]
        return spec


if "gymnasium" in sys.modules:
    register_environments(sys.modules["gymnasium"])
else:
    sys.meta_path.insert(0, _WhenGymnasiumComes())
