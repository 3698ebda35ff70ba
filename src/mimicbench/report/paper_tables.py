"""The numbers of the Mimicking-Bench paper, to stand beside ours.

Every pair is kinematic / energy-averaged success rate in percent: K, and the mean over the four limits of K and P.
The paper gives neither the number of episodes nor intervals.
"""

from collections.abc import Mapping
from dataclasses import dataclass

CITATION = "Mimicking-Bench: A Benchmark for Generalizable Humanoid-Scene Interaction Learning via Human Mimicking"
TASKS = {"sit-chair": "SC", "sit-sofa": "SS", "lie-bed": "LB", "lie-sofa": "LS", "touch-points": "T", "lift-box": "L"}
"""Our name of each task -> the paper's abbreviation, in the paper's order."""


COUNTERPARTS = {
    ("track", "hst"): "Improved HST",
    ("track", "tracker"): "Improved HST",
    ("track", "phc"): "Simplified PHC",
    ("track", "hst-original"): "Original HST",
    ("imitate", "act"): "ACT",
    ("imitate", "hit"): "HIT",
    ("imitate", "bc"): "Behavior Cloning",
    ("imitate", "diffusion"): "Diffusion Policy",
    ("imitate", "ppo"): "PPO",
    ("imitate", "omnih2o"): "OmniH2O",
    ("imitate", "humanplus"): "HumanPlus",
}
"""(stage, name of ours) -> the method of the paper that it is."""
RANKING = ("optimization", "omnih2o", "copy-rotation")
"""The paper's finding: each method of retargeting does better than the next."""


@dataclass(frozen=True)
class PaperRate:
    """One entry of the paper's tables."""

    kinematic: int
    """[%]"""
    energy: int
    """[%]"""


@dataclass(frozen=True)
class PaperTable:
    """One table of the paper."""

    label: str
    """LaTeX label in the paper."""
    caption: str
    measures: str
    """`tracking` or `imitation`: what was let loose on the task."""
    rates: Mapping[str, Mapping[str, PaperRate]]
    """Method -> task -> rate; tasks that the paper leaves out are missing."""
    mean: Mapping[str, PaperRate]
    """Method -> mean over the six tasks, as printed."""


def _table(label: str, caption: str, measures: str, tasks: tuple[str, ...], rows: Mapping[str, str]) -> PaperTable:
    """Read rows such as `92/70 90/89 ... 68/59`: one pair per task, then the mean if there are all six tasks."""
    rates, mean = {}, {}
    for method, line in rows.items():
        pairs = [PaperRate(*(int(number) for number in pair.split("/"))) for pair in line.split()]
        rates[method] = dict(zip(tasks, pairs, strict=False))
        if len(tasks) == len(TASKS):
            mean[method] = pairs[len(tasks)]
    return PaperTable(label, caption, measures, rates, mean)


_ALL = tuple(TASKS)

TABLES: tuple[PaperTable, ...] = (
    _table(
        "tab:pipeline_comparison",
        "Skill learning pipelines",
        "imitation",
        _ALL,
        {
            "PPO": "50/25 44/20 18/9 54/26 0/0 0/0 28/13",
            "HumanPlus": "36/28 17/16 36/34 38/36 46/32 4/3 30/25",
            "OmniH2O": "79/72 69/69 48/47 47/46 0/0 0/0 41/39",
            "Best Combination": "81/69 84/84 61/61 80/78 11/10 6/5 54/51",
        },
    ),
    _table(
        "tab:retargeting_comparison",
        "Motion retargeting algorithms, tracking",
        "tracking",
        _ALL,
        {
            "Copy-rotation": "66/46 90/89 84/77 38/36 0/0 0/0 46/41",
            "OmniH2O": "83/64 90/90 61/42 40/32 27/15 0/0 50/41",
            "Optimization": "92/70 90/89 88/82 55/53 58/40 25/20 68/59",
        },
    ),
    _table(
        "tab:retargeting_comparison",
        "Motion retargeting algorithms, imitation",
        "imitation",
        _ALL,
        {
            "Copy-rotation": "61/53 89/89 33/32 69/68 0/0 0/0 42/40",
            "OmniH2O": "79/72 69/69 48/47 47/46 0/0 0/0 41/39",
            "Optimization": "81/69 84/84 61/61 80/78 11/10 6/5 54/51",
        },
    ),
    _table(
        "tab:tracking_comparison",
        "Motion tracking algorithms, tracking",
        "tracking",
        _ALL,
        {
            "Simplified PHC": "87/65 92/83 63/49 80/61 8/6 0/0 55/44",
            "Improved HST": "92/70 90/89 88/82 55/53 58/40 25/20 68/59",
        },
    ),
    _table(
        "tab:tracking_comparison",
        "Motion tracking algorithms, imitation",
        "imitation",
        _ALL,
        {
            "Simplified PHC": "44/35 69/64 14/13 71/51 0/0 0/0 33/27",
            "Improved HST": "81/69 84/84 61/61 80/78 11/10 6/5 54/51",
        },
    ),
    _table(
        "tab:IL_comparison",
        "Imitation learning methods",
        "imitation",
        _ALL,
        {
            "HIT": "36/28 17/16 36/34 38/36 46/32 4/3 30/25",
            "ACT": "81/69 84/84 61/61 80/78 11/10 6/5 54/51",
        },
    ),
    _table(
        "tab:vision_comparison",
        "Vision modalities",
        "imitation",
        _ALL,
        {
            "Color and depth, four cameras": "0/0 0/0 1/1 13/13 8/6 1/1 4/4",
            "Elevation map": "81/69 84/84 61/61 80/78 11/10 6/5 54/51",
        },
    ),
    _table(
        "tab:data_scale_comparison",
        "Training data scales",
        "imitation",
        _ALL,
        {
            "10 %": "69/69 80/80 13/12 52/52 1/1 0/0 36/35",
            "100 %": "81/69 84/84 61/61 80/78 11/10 6/5 54/51",
        },
    ),
    _table(
        "tab:supp_experiment_tracking",
        "Motion tracking methods (appendix)",
        "tracking",
        _ALL,
        {
            "Original HST": "0/0 1/1 0/0 4/2 28/13 0/0 5/3",
            "Simplified PHC": "87/65 92/83 63/49 80/61 8/6 0/0 55/44",
            "Improved HST": "92/70 90/89 88/82 55/53 58/40 25/20 68/59",
        },
    ),
    _table(
        "tab:supp_experiment_IL",
        "Imitation learning methods on lying on a bed (appendix)",
        "imitation",
        ("lie-bed",),
        {
            "Behavior Cloning": "27/27",
            "Diffusion Policy": "7/7",
            "HIT": "36/34",
            "ACT": "61/61",
        },
    ),
)


_MAIN = {
    "tracking": ("tab:supp_experiment_tracking",),
    "imitation": ("tab:IL_comparison", "tab:supp_experiment_IL", "tab:pipeline_comparison"),
}
"""Where each method's own numbers stand; the other tables vary one part of the best combination."""


def best_of_paper(task: str, measures: str) -> PaperRate | None:
    """The best that the paper has on a task, in any of its tables; `measures` as for `methods`."""
    found = [
        rates[task] for table in TABLES if table.measures == measures for rates in table.rates.values() if task in rates
    ]
    return max(found, key=lambda rate: (rate.kinematic, rate.energy), default=None)


def methods(task: str, measures: str) -> dict[str, PaperRate]:
    """Every method of the paper with numbers on a task, best first; `measures` is `tracking` or `imitation`."""
    found: dict[str, PaperRate] = {}
    for label in _MAIN[measures]:
        for table in TABLES:
            if table.label == label and table.measures == measures:
                for method, rates in table.rates.items():
                    # the best combination is ACT on improved HST on optimization, and stands there as ACT
                    if task in rates and method != "Best Combination":
                        found.setdefault(method, rates[task])
    return dict(sorted(found.items(), key=lambda item: (-item[1].kinematic, -item[1].energy)))
