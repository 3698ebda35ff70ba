"""What a run is, as data, and the stages that follow from it.

from mimicbench.benchmark import Recipe, run_stage
run_stage("retarget", Recipe(task="sit-chair"), "work")
"""

from mimicbench.benchmark.graph import run_stage as run_stage
from mimicbench.benchmark.recipe import Recipe as Recipe
