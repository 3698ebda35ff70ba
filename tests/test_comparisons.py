"""Comparisons: recipes that differ in one thing, learned and judged side by side."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from episodes import EPISODE
from mimicbench import cli
from mimicbench.benchmark import Recipe
from mimicbench.benchmark.recipe import stage_type
from mimicbench.commands.compare import CompareOptions
from mimicbench.commands.parsing import read_compared
from mimicbench.comparisons.comparing import Compared
from mimicbench.comparisons.registry import COMPARISONS
from mimicbench.comparisons.spec import Comparison, Said, Variant, recipe_of
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.settings import BadSetting, differences, to_tree
from mimicbench.report.paper_tables import TABLES
from mimicbench.report.table import Reported
from mimicbench.report.tables.comparison import comparison_table, paper_rate
from mimicbench.tasks.registry import TASKS

SHARED = Comparison(
    "shared",
    "whether a clone copies itself",
    "imitate",
    (
        Variant("as it is"),
        Variant("relative", {"imitate": {"network": {"relative": True}}}),
        Variant("of a tenth", share=0.1, counterpart="10 %"),
    ),
    common={"imitate": {"learner": "bc", "train": {"steps": 7}}},
    paper=("tab:data_scale_comparison",),
)


def recipes_of(comparison, *words):
    """Of the one task of a command line."""
    (recipes,) = read_compared(comparison, words, CompareOptions).recipes
    return dict(zip((one.label for one in comparison.variants), recipes, strict=True))


@pytest.mark.parametrize("name", list(COMPARISONS))
@pytest.mark.parametrize("task", list(TASKS))
def test_every_variant_of_every_task_is_a_recipe_of_its_own(name, task):
    comparison = COMPARISONS.get(name)
    found = [recipe_of(comparison, one, Said(settings={"task": task})) for one in comparison.variants]
    assert all(isinstance(recipe, Recipe) and recipe.task == task for recipe in found)
    trees = [json.dumps(recipe.tree("references", "retarget", "track", "demos", "imitate")) for recipe in found]
    assert len(set(trees)) == len(trees), "two variants are the same recipe"


@pytest.mark.parametrize("name", list(COMPARISONS))
def test_what_it_calls_the_papers_is_the_papers(name):
    comparison = COMPARISONS.get(name)
    assert {*comparison.paper} <= {table.label for table in TABLES}
    assert bool(comparison.paper) == any(one.counterpart for one in comparison.variants)
    for one in comparison.variants:
        if one.counterpart:
            assert any(paper_rate(comparison, one.counterpart, task) for task in TASKS), one.label


def test_common_settings_then_presets_then_what_is_said_then_the_variant(tmp_path):
    found = recipes_of(SHARED)
    assert {one.imitate.learner for one in found.values()} == {"bc"}
    assert [one.imitate.train.steps for one in found.values()] == [7, 7, 7]
    assert [one.imitate.network.relative for one in found.values()] == [False, True, False]
    assert found["of a tenth"].references.count == 200
    words = ("--train.steps", "9", "--references.count", "50", "--network.hidden", "32", "--task", "lie-bed")
    found = recipes_of(SHARED, *words)
    assert {one.task for one in found.values()} == {"lie-bed"}
    assert [one.imitate.train.steps for one in found.values()] == [9, 9, 9]
    assert [one.imitate.network.hidden for one in found.values()] == [32, 32, 32]
    assert [one.references.count for one in found.values()] == [50, 50, 5]
    (tmp_path / "my.toml").write_text("preset = 'paper'\n[imitate]\ntrain.batch = 3\n")
    found = recipes_of(SHARED, "--config", str(tmp_path / "my.toml"), "--network.relative")
    assert {one.imitate.train.batch for one in found.values()} == {3}
    assert {one.imitate.network.hidden for one in found.values()} == {1024}
    assert all(one.imitate.network.relative for one in found.values())


def test_a_preset_is_asked_for_each_learner():
    found = recipes_of(COMPARISONS.get("learners"), "--preset", "paper")
    assert [one.imitate.learner for one in found.values()] == ["act", "hit", "bc", "diffusion"]
    assert found["HIT"].imitate.network.blocks == 6 and found["HIT"].imitate.train.steps == 100_000
    assert found["Diffusion Policy"].imitate.network.chunk == 16


def test_what_a_variant_has_not_is_told_with_its_name():
    with pytest.raises(BadSetting, match="learners, HIT: unknown setting imitate.network.kl_weight"):
        recipes_of(COMPARISONS.get("learners"), "--network.kl-weight", "3")


def test_settings_that_all_learners_have_are_said_once():
    found = recipes_of(COMPARISONS.get("learners"), "--train.steps", "9", "--preset", "smoke")
    assert [one.imitate.train.steps for one in found.values()] == [9, 9, 9, 9]
    assert [one.imitate.learner for one in found.values()] == ["act", "hit", "bc", "diffusion"]


def test_what_is_said_is_said_to_all():
    """Also where it is what the first of them would have had."""
    learners = COMPARISONS.get("learners")
    default = recipes_of(learners)["ACT"].imitate.train.steps
    found = recipes_of(learners, "--train.steps", str(default))
    assert [one.imitate.train.steps for one in found.values()] == [default] * 4
    found = recipes_of(learners, "--preset", "paper", "--train.batch", "8")
    assert [one.imitate.train.batch for one in found.values()] == [8] * 4
    found = recipes_of(learners, "--preset", "brief", "--train.steps", "50", "--demos.no-images")
    assert [one.imitate.train.steps for one in found.values()] == [50] * 4
    assert not any(one.demos.images for one in found.values())


def test_some_variants_alone():
    call = read_compared(SHARED, ("--only", "relative", "as it is"), CompareOptions)
    assert [one.label for one in call.comparison.variants] == ["relative", "as it is"]
    assert [len(one) for one in call.recipes] == [2]
    with pytest.raises(BadSetting, match="shared has no variant 'nothing'; there are: as it is, relative, of a tenth"):
        read_compared(SHARED, ("--only", "nothing"), CompareOptions)
    with pytest.raises(BadSetting, match="of a tenth.*; did you mean 'as it is'"):
        read_compared(SHARED, ("--only", "As It Is"), CompareOptions)
    assert len(read_compared(SHARED, ("--only", "relative", "relative"), CompareOptions).comparison.variants) == 1


def test_all_tasks():
    call = read_compared(SHARED, ("--task", "all"), CompareOptions)
    assert [one[0].task for one in call.recipes] == list(TASKS)


def test_labels_are_told_apart():
    with pytest.raises(BadSetting, match="comparison 'twice' has two variants of one label"):
        Comparison("twice", "nothing", "track", (Variant("a"), Variant("a")))


def test_differences_are_what_has_to_be_said():
    act = stage_type("imitate", {"learner": "act"})
    one, other = act(), act(learner="act", network=act().network.small())
    assert differences(one, other) == {}
    changed = replace(one, train=replace(one.train, steps=5, betas=(0.5, 0.6)))
    assert differences(changed, one) == {"train": {"steps": 5, "betas": [0.5, 0.6]}}
    assert to_tree(changed)["train"]["steps"] == 5


def test_the_table_has_the_papers_numbers_beside_ours():
    found = [
        Compared(one, Path(), [replace(EPISODE, episode=i, success=i < n) for i in range(4)])
        for one, n in zip(SHARED.variants, (3, 2, 1), strict=True)
    ]
    table = comparison_table(SHARED, found)
    assert table.columns == ("Variant", "K, ours", "K, paper", "K and P, ours", "K and P, paper", "Stays", "Fell")
    assert [row[0] for row in table.rows] == ["as it is", "relative", "of a tenth"]
    assert [row[1].successes for row in table.rows] == [3, 2, 1]
    assert [row[2] for row in table.rows] == [None, None, Reported(69)] and table.rows[2][4] == Reported(69)
    alone = comparison_table(Comparison("alone", "nothing", "imitate", (found[0].variant,)), found[:1])
    assert alone.columns == ("Variant", "K", "K and P", "Stays", "Fell")


def test_variants_with_different_clips_are_compared_on_those_that_all_have():
    """One has the clips 0 to 3, another 2 to 5; a third could not be judged, and takes no clip from the others."""

    def on(clips, success):
        return [replace(EPISODE, episode=i, reference_id=f"clip-{i}", success=success(i)) for i in clips]

    variants = SHARED.variants
    found = [
        Compared(variants[0], Path(), on((0, 1, 2, 3), lambda i: i < 3)),
        Compared(variants[1], Path(), on((5, 4, 3, 2), lambda i: i in (2, 3))),
        Compared(variants[2], None, (), "there are no clips"),
    ]
    table = comparison_table(SHARED, found)
    assert table.columns[5:7] == ("K, shared clips", "K and P, shared clips")
    assert [(row[1].successes, row[1].episodes) for row in table.rows[:2]] == [(3, 4), (2, 4)]
    assert [(row[5].successes, row[5].episodes) for row in table.rows[:2]] == [(1, 2), (2, 2)]
    assert table.rows[1][6].successes == 2.0 and table.rows[2][5:7] == (None, None)
    assert "on the 2 clips that all who were judged have" in table.note
    assert "on the same people and objects" not in table.note
    apart = [found[0], Compared(variants[1], Path(), on((7, 8), lambda i: True)), found[2]]
    assert [row[5] for row in comparison_table(SHARED, apart).rows] == [None] * 3
    other = [replace(row, object_id="chair-0-00002") for row in found[0].rows]
    told = comparison_table(SHARED, [found[0], Compared(variants[1], Path(), other), found[2]]).note
    assert "on the 0 clips" in told, "a clip of the same name beside another object is another clip"


def test_a_variant_that_cannot_be_judged_is_told_and_the_others_are():
    failed = Compared(SHARED.variants[0], None, (), "there are no clips")
    found = [failed, *(Compared(one, Path(), [EPISODE]) for one in SHARED.variants[1:])]
    table = comparison_table(SHARED, found)
    assert table.rows[0] == ("as it is", *(None,) * 6) and "as it is: there are no clips." in table.note
    assert table.rows[1][1].successes == 1


def test_a_comparison_end_to_end_is_not_made_twice(tmp_path, capsys):
    words = "compare learners --only BC --task sit-chair --objects.count 5 --references.count 3"
    words += " --imitate.learner bc --train.steps 3 --train.batch 4 --evaluate.episodes 1 --workers 1"
    argv = [*words.split(), "--workdir", str(tmp_path)]
    cli.main([*argv, "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told["comparison"] == "learners" and told["variant"] == "BC" and told["policy"] == "bc"
    assert told["kinematic"]["episodes"] == 1 and told["folder"].startswith(str(tmp_path))
    made = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    cli.main(argv)
    told = capsys.readouterr().out
    assert "BC" in told and "Learners that clone the same demonstrations (sit-chair)" in told
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()} == made


def test_a_tracker_learns_here_where_one_is_shipped_and_is_judged_where_none_is_to_learn(tmp_path, capsys):
    words = "--task sit-chair --objects.count 5 --references.count 4 --evaluate.tracked 1 --workers 1 --json"
    learned = "--track.samples 32 --num-envs 4 --parts 1 --ppo.steps 4 --ppo.hidden 16 --evaluate-clips 1 --only"
    common = [*words.split(), "--workdir", str(tmp_path)]
    cli.main(["compare", "trackers", *common, *learned.split(), "residual (ours)"])
    assert json.loads(capsys.readouterr().out)["folder"].startswith(str(tmp_path)), "not the shipped one"
    cli.main(["compare", "retargeting", *common, "--only", "interaction"])
    assert "checkpoints" in json.loads(capsys.readouterr().out)["folder"]
    # where none is shipped for what is asked for, the first one trains one, and the others have that
    own = learned.replace("--only", "--track.frames 2 --only").split()
    cli.main(["compare", "retargeting", *common, *own, "interaction", "optimization"])
    told = json.loads(capsys.readouterr().out)
    first, second = told
    assert first["variant"] != second["variant"] and first["folder"] == second["folder"]


@pytest.mark.parametrize("words", [[], ["--task", "sit-chair"], ["nothing"]])
def test_a_comparison_has_to_be_named(words):
    with pytest.raises(MimicbenchError, match="pipelines"):
        cli._call(["compare", *words])


def test_comparisons_are_listed(capsys):
    cli.main(["compare", "list"])
    told = capsys.readouterr().out
    assert all(name in told for name in COMPARISONS)


def test_a_share_is_of_what_demonstrations_begin_from():
    """Of people who are made, or of starts by rule; a set of somebody's recordings is used whole."""
    part = SHARED.variants[2]
    people = recipe_of(SHARED, part, Said(settings={"references": {"count": 50}}))
    assert people.references.count == 5
    starts = {"demos": {"starts": "rule", "expert": "planner", "clips": 300}, "references": {"count": 50}}
    ruled = recipe_of(SHARED, part, Said(settings=starts))
    assert (ruled.demos.clips, ruled.references.count) == (30, 50)
    with pytest.raises(BadSetting, match="shared, of a tenth: the set 'recorded' is used whole"):
        recipe_of(SHARED, part, Said(settings={"references": {"source": "recorded"}}))


def test_fewer_people_give_fewer_demonstrations_though_more_are_made_than_are_kept():
    cut = recipe_of(
        SHARED, SHARED.variants[2], Said(settings={"references": {"count": 8000}, "demos": {"clips": 1500}})
    )
    assert (cut.references.count, cut.demos.clips) == (800, 150)
