"""The published sample: whole, as its card says, and to be learned from without training a tracker first."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from mimicbench.benchmark import Recipe, run_stage
from mimicbench.benchmark.graph import make_imitate_stage
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.published import published_clips
from mimicbench.benchmark.recipe import read_recipe
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.benchmark.verifying import verify_demos
from mimicbench.core.checkpoint import CONFIG
from mimicbench.core.errors import BadFile
from mimicbench.core.files import read_json
from mimicbench.core.run import RunContext
from mimicbench.core.settings import BadSetting
from mimicbench.imitate.lerobot import load_demos, recorded_gains
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.track.registry import TRACKERS
from mimicbench.viewer.catalog import Catalog
from mimicbench.viewer.opened import open_item

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "examples" / "sample"
RECIPE = Recipe("sit-chair", demos=DemosConfig(source="sample"))
RUN = Run(RECIPE, SAMPLE, RunContext(workers=1, quiet=True))


def test_it_is_small_and_its_card_has_its_numbers():
    size = sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file())
    assert size < 8e6
    demos = load_demos(SAMPLE / "sit-chair" / "demos" / "sample" / "dataset", "h1", state=True)
    card = (SAMPLE / "README.md").read_text()
    assert f"{demos.episodes} episodes" in card and f"{len(demos.action)} frames" in card
    assert demos.state.shape == (len(demos.action), 300) and np.isfinite(demos.state).all()


def test_all_of_it_can_be_looked_at():
    catalog = Catalog(SAMPLE)
    (sample,) = catalog.sets("sit-chair", "demos")
    found = open_item(catalog, sample, sample.items[-1])
    assert len(sample.items) == 4 and found.facts[0].startswith("demonstration 3: fulfills K")
    assert set(found.tracks) == {"human", "retargeted", "robot"}


def test_every_demonstration_sits_and_stays_by_its_states():
    found = verify_demos(RUN)
    assert found["demonstrations"] == found["fulfilled"] > 0 and not found["wrong"]
    assert found["gains"] == "improved"


def test_it_brings_the_clips_and_objects_that_it_follows():
    clips = published_clips(RUN)
    demos = load_demos(SAMPLE / "sit-chair" / "demos" / "sample" / "dataset", "h1", state=False)
    assert set(demos.reference_ids) <= {motion.id for motion in clips.motions}
    assert set(demos.object_ids) <= set(clips.objects)
    assert published_clips(Run(Recipe("sit-chair"), SAMPLE)) is None, "demonstrations that are made"


def test_whoever_asks_for_them_gets_them_and_nothing_is_made():
    before = sorted(SAMPLE.rglob("*"))
    assert run_stage("demos", RECIPE, SAMPLE, RUN.context).folder == SAMPLE / "sit-chair" / "demos" / "sample"
    assert sorted(SAMPLE.rglob("*")) == before


def test_a_set_that_is_not_there_is_told(tmp_path):
    with pytest.raises(BadFile, match="give the --workdir that has the set 'sample'"):
        run_stage("demos", RECIPE, tmp_path, RUN.context)


def clone_of_it(**imitate):
    """A recipe that clones it, in no time."""
    small = {"encoder": {"widths": [2, 2, 2]}, "hidden": 8}
    learned = {"learner": "bc", "network": small, "train": {"steps": 2, "batch": 4}, **imitate}
    return read_recipe({"task": "sit-chair", "demos": {"source": "sample"}, "imitate": learned})


def test_a_policy_is_cloned_from_it(tmp_path):
    shutil.copytree(SAMPLE, tmp_path / "work")
    made = run_stage("imitate", clone_of_it(), tmp_path / "work", RUN.context)
    assert made.header["reads"]["demos"] == "demos/sample" and (made.folder / "policy" / "config.json").exists()
    assert sorted(path.name for path in (tmp_path / "work" / "sit-chair").iterdir()) == [
        "demos", "imitate", "objects", "references", "retarget",
    ]  # fmt: skip


def test_its_clone_drives_the_gains_that_it_was_made_with(tmp_path):
    """It does not record them: they are those of its own tracker, whichever tracker the recipe has."""
    assert recorded_gains(SAMPLE / "sit-chair" / "demos" / "sample" / "dataset") is None
    assert TRACKERS.get("hst").gains == "paper", "else nothing is told apart"
    shutil.copytree(SAMPLE, tmp_path / "work")

    def cloned(**imitate):
        run = Run(clone_of_it(**imitate), tmp_path / "work", RUN.context, SHIPPED / "sit-chair" / "hst")
        return make_imitate_stage(run).folder / "policy"

    assert read_json(cloned() / CONFIG)["notes"]["gains"] == "improved"
    with pytest.raises(BadSetting, match="imitate.gains is 'paper', but the demonstrations were made with 'improved'"):
        cloned(gains="paper")
    with pytest.raises(BadFile, match="in the rounds of imitate.dagger drives 'paper'; leave the rounds out"):
        cloned(dagger={"rounds": 1})
