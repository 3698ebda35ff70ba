"""Make examples/sample anew: a few demonstrations by the shipped tracker, with the objects and clips that they follow.

python scripts/make_sample.py
"""

import shutil
import tempfile
from pathlib import Path

from mimicbench.benchmark import Recipe, run_stage
from mimicbench.core.run import RunContext
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.objects.make import ObjectsConfig
from mimicbench.references.settings import ReferencesConfig

SAMPLE = Path(__file__).parents[1] / "examples" / "sample"
NAME = "sample"
RECIPE = Recipe(
    "sit-chair",
    objects=ObjectsConfig(count=8),
    references=ReferencesConfig(count=6),
    demos=DemosConfig(clips=4, clean_share=0.5),
)


def main() -> None:
    """Make the stages in a folder of their own, and put them into the repository with the data set under its name."""
    with tempfile.TemporaryDirectory() as folder:
        made = run_stage("demos", RECIPE, Path(folder), RunContext(workers=1))
        made.folder.rename(made.folder.with_name(NAME))
        target = SAMPLE / RECIPE.task
        shutil.rmtree(target, ignore_errors=True)
        for stage in ("objects", "references", "retarget", "demos"):
            shutil.copytree(Path(folder) / RECIPE.task / stage, target / stage)
    print(f"{sum(path.stat().st_size for path in target.rglob('*')) / 1e6:.1f} MB in {target}")


if __name__ == "__main__":
    main()
