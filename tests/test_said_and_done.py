"""What is said is done: options that count, labels that fit, comparisons that train nothing where that is asked."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from mimicbench.benchmark import published
from mimicbench.benchmark.experts import who_demonstrated
from mimicbench.benchmark.presets import PRESETS, Chosen
from mimicbench.benchmark.recipe import read_recipe
from mimicbench.comparisons import comparing
from mimicbench.comparisons.spec import Comparison, Variant
from mimicbench.core.settings import BadSetting
from mimicbench.imitate.demos import batches
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.references.paper import PAPER_SETS
from mimicbench.report.tables.spec import Episodes
from mimicbench.report.write import draw_plots
from mimicbench.sim.rows import Rows
from mimicbench.track.history import History
from mimicbench.track.settings import TrackConfig
from mimicbench.track.train import _course
from test_policies import clip_set
from test_report import JUDGED


@pytest.mark.parametrize("task", list(PAPER_SETS))
def test_the_papers_preset_lets_all_of_its_people_demonstrate(task):
    recipe = read_recipe({"task": task, **PRESETS["paper"](Chosen(task))})
    assert recipe.demos is not None and recipe.references is not None
    assert recipe.demos.clips >= recipe.references.count


def test_pushes_need_no_noise_of_actions():
    clips = clip_set(4, 0.1)
    config = DemosConfig(action_noise=0.0, push=0.3, clean_share=0.5, batch=2)
    assert [(len(part), clean) for part, clean in batches(clips, config)] == [(2, True), (2, False)]


def demonstrations(reads, rounds):
    """A named set that was made from these, and who wants rounds after it."""
    parts = {"demos": DemosConfig(source="theirs"), "imitate": SimpleNamespace(dagger=SimpleNamespace(rounds=rounds))}
    return SimpleNamespace(part=parts.__getitem__), SimpleNamespace(header={"reads": reads})


def test_nobody_labels_what_was_begun_where_starts_were_drawn(tmp_path):
    """The tracker on a clip of somebody who stands would say: stand."""
    run, demos = demonstrations({"objects": "o", "retarget": "r"}, 0)
    assert not published.follow_clips(demos)
    assert who_demonstrated(run, demos, tmp_path) == (None, False)
    run, demos = demonstrations({"objects": "o"}, 2)
    with pytest.raises(BadSetting, match="'theirs' follow no clips"):
        who_demonstrated(run, demos, tmp_path)
    assert published.follow_clips(demonstrations({"retarget": "r"}, 0)[1])


def test_a_comparison_that_learns_nothing_trains_nothing(monkeypatch, tmp_path):
    def refuse(run):
        raise AssertionError("it was to train nothing")

    monkeypatch.setattr(comparing, "make_imitate_stage", refuse)
    monkeypatch.setattr(comparing, "judge", lambda run, name: [name])
    recipe = read_recipe({"imitate": {"learner": "bc"}})
    variant = Variant("as shipped")
    comparison = Comparison("told", "t", "imitate", (variant,), learns=False)
    (found,) = comparing.compare(comparison, [recipe], tmp_path)
    assert found.rows == ["bc"] and found.folder is not None and found.folder.name == "bc"


def test_where_nobody_stays_a_report_does_not_say_that_no_episode_failed():
    rows = tuple(replace(row, stays=False) for row in JUDGED.rows if row.success)
    assert "failures" in draw_plots("sit-chair", Episodes(rows), ())


def test_what_a_tracker_saw_is_its_own():
    """Whoever carries it for it, such as an ONNX graph, finds it as it was."""
    history = History(SimpleNamespace(size=2, frames=3), 2)
    held = {"past": torch.ones(2, 4)}
    history.load_state_tensors(held)
    history.begin(Rows.every(2, "cpu"))
    assert (held["past"] == 1).all() and not history.past.any()


def test_a_tracker_to_begin_from_may_be_spelled_otherwise():
    assert _course(TrackConfig(begin_from="a/b")) == _course(TrackConfig(begin_from="/somewhere/a/b/"))
    assert _course(TrackConfig(num_envs=3)) != _course(TrackConfig())
