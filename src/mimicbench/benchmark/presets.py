"""Named recipes: trees of values for `recipe.read_recipe`. What a preset leaves out has its default.

`ours` is all defaults. `paper` is the paper; where it is silent, the source that it names: the public HumanPlus code
for the training of HST, and ACT's for ACT. Sizes: `smoke` shows that every stage works, `default` fits ten minutes,
`full` is what our results were made with, `paper-size` has as many objects and clips as the paper. `new-objects` has
another seed than what is shipped was trained with.
"""

from collections.abc import Callable, Mapping
from typing import Any

from mimicbench.core.errors import UnknownName
from mimicbench.core.settings import merge

Tree = dict[str, Any]

HST_PPO: Tree = {
    "hidden": [512, 512, 512],
    "steps": 32,
    "epochs": 2,
    "minibatches": 4,
    "gamma": 0.99,
    "lam": 0.95,
    "clip": 0.2,
    "entropy": 1e-5,
    "learning_rate": 1e-4,
    "initial_std": 1.0,
    "schedule": "fixed",
    "optimizer": "adamw",
    "scale_rewards": False,
}
"""HumanPlus' training of HST: 2048 robots, 32 steps, a fixed rate."""


ENDS: Tree = {"max_pos_error": 0.5, "max_angle_error": 1e3, "max_drop": 0.5, "max_object_error": 1e3}
"""0.5 m off the reference (F.4), and nothing else: the threshold of the height is not given, and within that."""


def _sizes(objects: int, clips: int, tracked: int, episodes: int, policies: tuple[str, ...]) -> Tree:
    return {
        "objects": {"count": objects},
        "references": {"count": clips},
        "evaluate": {"tracked": tracked, "episodes": episodes, "policy": ["tracker", *policies]},
    }


def _paper_size(task: str) -> Tree:
    from mimicbench.references.paper import PAPER_SETS

    if task not in PAPER_SETS:
        raise UnknownName("task of the paper", task, list(PAPER_SETS))
    return {"objects": {"count": PAPER_SETS[task].objects}, "references": {"count": PAPER_SETS[task].clips}}


def _paper(task: str) -> Tree:
    """The paper's best combination: optimization, improved HST, ACT on the elevation map."""
    starts = {"pos_noise": 0.0, "angle_noise": 0.0, "vel_noise": 0.0}
    tracking = {"focus": 0.0, "hold": 0.0, "push": 0.0, "starts": starts, "ends": ENDS}
    return merge(
        _paper_size(task),
        {
            "retarget": {"method": "optimization", "variant": "paper"},
            "track": {"tracker": "hst", "num_envs": 2048, "ppo": HST_PPO, "tracking": tracking},
            "imitate": {"learner": "act"},
        },
    )


def _omnih2o(task: str) -> Tree:
    """OmniH2O's retargeting under the paper's tracker and best imitation."""
    return merge(_paper(task), {"retarget": {"method": "omnih2o", "variant": "paper"}})


PRESETS: Mapping[str, Callable[[str], Tree]] = {
    "ours": lambda task: {},
    "paper": _paper,
    "omnih2o": _omnih2o,
    "paper-size": _paper_size,
    "new-objects": lambda task: {"seed": 1},
    "smoke": lambda task: _sizes(16, 16, 16, 16, ("planner",)),
    "default": lambda task: _sizes(120, 128, 128, 128, ("planner", "act-clock", "bc-clock")),
    "full": lambda task: _sizes(400, 2000, 256, 400, ("planner", "act", "bc", "act-clock", "bc-clock")),
}
PROFILES = ("smoke", "default", "full")


def preset_tree(name: str, task: str) -> Tree:
    """The values of a preset for a task. Raises UnknownName."""
    if name not in PRESETS:
        raise UnknownName("preset", name, list(PRESETS))
    return PRESETS[name](task)
