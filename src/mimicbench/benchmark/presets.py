"""Named recipes: trees of values for `recipe.read_recipe`. What a preset leaves out has its default.

`ours` is all defaults. `paper` is the paper; where it is silent, the source that it names: the public HumanPlus code
for the training of HST and HIT, ACT's for ACT and BC, Diffusion Policy's own. Sizes: `smoke` shows that every stage
works, `default` fits ten minutes, `full` is what our results were made with, `brief` is for trainings what `smoke` is
for the rest, `paper-size` has as many objects and clips as the paper. `new-objects` has another seed than what is
shipped was trained with.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
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
    "critic_rate": None,
    "scale_rewards": True,
}
"""HumanPlus' training of HST: 2048 robots, 32 steps, a fixed rate. It multiplies its rewards by the time step, and so
must F.3's be made smaller, of which a step has up to 26: a clipped value moves by 0.2 per update."""


ENDS: Tree = {"max_pos_error": 0.5, "max_angle_error": 1e3, "max_drop": 0.5, "max_object_error": 1e3}
"""0.5 m off the reference (F.4), and nothing else: the threshold of the height is not given, and within that."""


PAPER_MAP: Tree = {
    "channels": 1,
    "cells": 128,
    "pool": 1,
    "patch": 0,
    "norm": "group",
    "coordinates": False,
    "widths": [64, 128, 256, 512],
    "blocks": [2, 2, 2, 2],
    "strides": [1, 2, 2, 2],
}
"""ResNet-18 on the whole elevation map."""
PAPER_NETWORKS: Mapping[str, Tree] = {
    "act": {
        "encoder": PAPER_MAP,
        "chunk": 100,
        "hidden": 512,
        "feedforward": 3200,
        "heads": 8,
        "posterior_layers": 4,
        "encoder_layers": 4,
        "decoder_layers": 7,
        "latent": 32,
        "dropout": 0.1,
        "kl_weight": 10.0,
    },
    "bc": {"encoder": PAPER_MAP, "reduce": [128, 64, 32], "hidden": 1024},
    "hit": {
        "encoder": PAPER_MAP,
        "chunk": 50,
        "hidden": 512,
        "heads": 8,
        "blocks": 6,
        "dropout": 0.1,
        "feature_weight": 0.005,
    },
    "diffusion": {
        "encoder": PAPER_MAP,
        "chunk": 16,
        "executes": 8,
        "widths": [512, 1024, 2048],
        "kernel": 5,
        "groups": 8,
        "step_embedding": 128,
        "noise_steps": 100,
        "sample_steps": 16,
    },
}
"""Sizes by learner: of ACT and CNNMLP as the public code of ACT has them, of HIT as HumanPlus' README trains it, of
Diffusion Policy those of its U-Net on images, sampled as on its real robots."""
EPOCHS, BATCH = 2000, 8
"""Of ACT's training: an epoch shows one frame of each demonstration."""
PLAIN: Tree = {
    "batch": BATCH,
    "learning_rate": 1e-5,
    "schedule": "constant",
    "warmup": 0.0,
    "weight_decay": 1e-4,
    "clip": 0.0,
    "average": 0.0,
}
"""AdamW at a fixed rate, no warm-up, no limit of the gradient, the last weights."""
LONG = 100_000
"""Batches of HIT's training. Epochs of Diffusion Policy's show every frame, of which the paper has a hundred times as
many: it gets as many batches as HIT."""
OWN_TRAINING: Mapping[str, Tree] = {
    "hit": {**PLAIN, "steps": LONG, "batch": 48},
    "diffusion": {
        "steps": LONG,
        "batch": 64,
        "learning_rate": 1e-4,
        "schedule": "cosine",
        "warmup": 500 / LONG,
        "weight_decay": 1e-6,
        "betas": [0.95, 0.999],
        "clip": 0.0,
        "average": 0.9998,
    },
}
"""HumanPlus' training of HIT, and Diffusion Policy's, whose average forgets ever more slowly and ends at this decay."""


PAPER_UNTAUGHT: Mapping[str, Tree] = {
    "ppo": {
        "gains": "paper",
        "network": {"encoder": PAPER_MAP, "convolves": True, "features": 512, "hidden": [512, 512, 512], "scale": 1.0},
        "ppo": HST_PPO,
        "explore": {"num_envs": 2048, "approach": 0.0},
        "samples": 1_000_000_000,
    },
}
"""Who learns without references, of whom the paper says that it is PPO and sees: its gains, its trackers' updates, and
a reward of nearness alone. How long it learned is not told: so many samples are ours."""


def _paper_training(learner: str, clips: int) -> Tree:
    """That of its own source; ACT's and CNNMLP's go by epochs, of which three quarters of the clips are on training
    objects.
    """
    return OWN_TRAINING.get(learner) or {**PLAIN, "steps": EPOCHS * (clips * 3 // 4) // BATCH}


def _sizes(objects: int, clips: int, tracked: int, episodes: int, policies: tuple[str, ...]) -> Tree:
    return {
        "objects": {"count": objects},
        "references": {"count": clips},
        "evaluate": {"tracked": tracked, "episodes": episodes, "policy": ["tracker", *policies]},
    }


def _policies(task: str, *others: str) -> tuple[str, ...]:
    """The first learner whose policy comes with the package for a task, or else a planner, and some others that do."""
    from mimicbench.benchmark.shipped import SHIPPED
    from mimicbench.core.checkpoint import CONFIG
    from mimicbench.imitate.registry import LEARNERS

    there = [name for name in LEARNERS if (SHIPPED / task / name / CONFIG).exists()]
    return tuple(dict.fromkeys([*(there[:1] or ["planner"]), *(name for name in others if name in there)]))


@dataclass(frozen=True)
class Chosen:
    """Names on which the values of a preset depend."""

    task: str
    learner: str | None = None
    """None where nobody names one."""


def _paper_size(chosen: Chosen) -> Tree:
    from mimicbench.references.paper import PAPER_SETS

    task = chosen.task
    if task not in PAPER_SETS:
        raise UnknownName("task of the paper", task, list(PAPER_SETS))
    clips = PAPER_SETS[task].clips
    return {"objects": {"count": PAPER_SETS[task].objects}, "references": {"count": clips}, "demos": {"clips": clips}}


def _paper(chosen: Chosen) -> Tree:
    """The paper's best combination: optimization, improved HST, ACT on the elevation map; or another learner of the
    paper's, if one is named.
    """
    sizes, learner = _paper_size(chosen), chosen.learner or "act"
    imitate: Tree = {"learner": learner, **PAPER_UNTAUGHT.get(learner, {})}
    if learner in PAPER_NETWORKS:
        clips = sizes["references"]["count"]
        imitate |= {"network": PAPER_NETWORKS[learner], "train": _paper_training(learner, clips)}
    starts = {"pos_noise": 0.0, "angle_noise": 0.0, "vel_noise": 0.0}
    tracking = {"focus": 0.0, "hold": 0.0, "push": 0.0, "starts": starts, "ends": ENDS}
    return merge(
        sizes,
        {
            "retarget": {"method": "optimization", "variant": "paper"},
            "track": {"tracker": "hst", "num_envs": 2048, "ppo": HST_PPO, "tracking": tracking},
            "demos": {"action_noise": 0.0, "push": 0.0},
            "imitate": imitate,
        },
    )


def _hst_original(chosen: Chosen) -> Tree:
    """The paper with the tracker of HumanPlus as it is (E.1): it starts at the first frame, is shoved by 1 m/s at most
    every 15 s, and fails by its own ends alone.

    Speeds are drawn with the deviation that HumanPlus' even draws have, 1/sqrt(3) of the largest.
    """
    nowhere = {"max_pos_error": 1e3, "max_angle_error": 1e3, "max_drop": 1e3, "max_object_error": 1e3}
    starts = {"first_frame": 1.0, "vel_noise": 0.29}
    tracking = {"push": 0.58, "push_interval": 15.0, "starts": starts, "ends": nowhere}
    ppo = {"scale_rewards": False}  # its own rewards are by the second
    return merge(_paper(chosen), {"track": {"tracker": "hst-original", "tracking": tracking, "ppo": ppo}})


def _omnih2o(chosen: Chosen) -> Tree:
    """OmniH2O's retargeting under the paper's tracker and best imitation."""
    return merge(_paper(chosen), {"retarget": {"method": "omnih2o", "variant": "paper"}})


BRIEF: Tree = {
    "perception": {"maps": 500, "steps": 200},
    "planner": {"samples": 50_000},
    "train": {"steps": 100},
    "samples": 50_000,
}
"""Trainings of about a minute, by what learners call them."""


def _brief(chosen: Chosen) -> Tree:
    """Every training is over in a minute or so, and has learned next to nothing."""
    from mimicbench.imitate.registry import LEARNERS

    learner = chosen.learner or _policies(chosen.task)[0]
    own = {entry.name for entry in fields(LEARNERS.get(learner).config)}
    less = {name: value for name, value in BRIEF.items() if name in own}
    return {"track": {"samples": 100_000}, "imitate": {"learner": learner, **less}}


PRESETS: Mapping[str, Callable[[Chosen], Tree]] = {
    "ours": lambda _: {},
    "paper": _paper,
    "omnih2o": _omnih2o,
    "hst-original": _hst_original,
    "paper-size": _paper_size,
    "new-objects": lambda _: {"seed": 1},
    "smoke": lambda chosen: _sizes(16, 16, 16, 16, _policies(chosen.task)),
    "default": lambda chosen: _sizes(120, 128, 128, 128, _policies(chosen.task, "planner", "bc-clock")),
    "brief": _brief,
    "full": lambda chosen: _sizes(400, 2000, 256, 400, _policies(chosen.task, "planner", "act", "bc", "bc-clock")),
}


def preset_tree(name: str, chosen: Chosen) -> Tree:
    """The values of a preset for what is chosen besides. Raises UnknownName."""
    if name not in PRESETS:
        raise UnknownName("preset", name, list(PRESETS))
    return PRESETS[name](chosen)
