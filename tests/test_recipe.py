"""Recipes: where their values come from, what they refuse, and that stages of several recipes share what is common."""

import json
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, ClassVar

import numpy as np
import pytest

import making
from mimicbench import cli
from mimicbench.benchmark import Recipe, keys, run_stage
from mimicbench.benchmark.finding import stages_of
from mimicbench.benchmark.graph import start
from mimicbench.benchmark.judging import episodes_of, episodes_to_show, judge, rows_path
from mimicbench.benchmark.presets import PRESETS, Chosen, preset_tree
from mimicbench.benchmark.recipe import EvaluateConfig, check_recipe, read_recipe, recipe_tree, stage_type
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.commands.judge import check_acted, read_run
from mimicbench.commands.parsing import read_call
from mimicbench.core.checkpoint import CONFIG
from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.core.run import RunContext
from mimicbench.core.settings import Amount, BadSetting, Later, Within, amounts, check, identity, merge, read
from mimicbench.core.stage import read_stage
from mimicbench.evaluate.rollout import Protocol
from mimicbench.evaluate.rows import read_rows, rows_made_from, write_rows
from mimicbench.imitate.learners.act import ACTConfig
from mimicbench.imitate.learners.bc import BCConfig
from mimicbench.imitate.learners.diffusion import DiffusionConfig
from mimicbench.imitate.learners.hit import HITConfig
from mimicbench.imitate.registry import LEARNERS
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.imitate.spec import CloneImitation, ImitateConfig
from mimicbench.objects.make import ObjectsConfig
from mimicbench.references.settings import ReferencesConfig
from mimicbench.retarget.settings import RetargetConfig
from mimicbench.sensors.observations import chosen_terms
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import TrackConfig


@dataclass(frozen=True)
class Inner:
    rate: Annotated[float, Within(0, 1)] = 0.5
    sizes: tuple[int, ...] = (2, 3)


@dataclass(frozen=True)
class Outer:
    samples: Annotated[int, Amount()] = 10
    name: str = "x"
    steps: Annotated[int, Within(1, 9)] | None = None
    inner: Inner = field(default_factory=Inner)


# --- settings


def test_amounts_are_no_part_of_identity():
    assert identity(Outer()) == {"name": "x", "steps": None, "inner": {"rate": 0.5, "sizes": [2, 3]}}
    assert amounts(Outer(samples=7)) == {"samples": 7}


def test_a_program_cannot_give_what_a_command_line_could_not():
    for wrong in (Outer(samples="4"), Outer(samples=1.5), Outer(name=3), Outer(inner={"rate": 0.5}), Outer(steps="2")):
        with pytest.raises(BadSetting, match="cannot be|is a dict; give a Inner"):
            check(wrong)
    for wrong in (Recipe(seed=1.5), Recipe(seed="0"), Recipe(objects=ObjectsConfig(count="4"))):
        with pytest.raises(BadSetting, match="cannot be"):
            check_recipe(wrong)
    with pytest.raises(BadSetting, match="objects is a dict; give its configuration"):
        check_recipe(Recipe(objects={"count": 4}))
    few = TrackConfig(num_envs=4, ppo=replace(TrackConfig().ppo, steps=1, minibatches=100))
    with pytest.raises(BadSetting, match="less than one sample for each of ppo.minibatches 100"):
        check_recipe(Recipe(track=few))


@dataclass(frozen=True)
class Grown(Inner):
    since: Annotated[float, Within(0, 1), Later()] = 0.0


def test_what_came_later_determines_nothing_at_its_default():
    assert identity(Grown()) == identity(Inner()) and identity(Outer(inner=Grown())) == identity(Outer())
    assert identity(Grown(since=0.5)) == {**identity(Inner()), "since": 0.5}
    with pytest.raises(BadSetting, match="since is 2"):
        check(Grown(since=2.0))


@dataclass(frozen=True)
class Changed:
    inner: Inner = field(default_factory=lambda: Inner(0.25, (7,)))


def test_what_a_tree_leaves_out_is_as_it_stands_there():
    assert read(Changed, {"inner": {"rate": 1.0}}) == Changed(Inner(1.0, (7,))), "not the class's own sizes"
    assert read(Outer, {"inner": {"rate": 1.0}}) == Outer(inner=Inner(1.0, (2, 3)))
    clone = read_recipe({"imitate": {"learner": "bc", "network": {"relative": True}}}).imitate
    assert clone.network == replace(BCConfig.small(), relative=True), "a switch does not make a network large"


def test_encoders_that_do_not_fit_together_are_told():
    with pytest.raises(BadSetting, match="one stride less than widths"):
        read_recipe({"imitate": {"learner": "bc", "network": {"encoder": {"widths": [4, 4, 4, 4]}}}})
    with pytest.raises(BadSetting, match="as many strides and blocks as widths"):
        read_recipe({"imitate": {"learner": "bc", "network": {"encoder": {"patch": 0}}}})


@pytest.mark.parametrize("tree", [{"train": {"schedule": "cosin"}}, {"network": {"encoder": {"norm": "layer"}}}])
def test_a_misspelt_choice_is_not_another_choice(tree):
    with pytest.raises(BadSetting, match="cannot be"):
        read_recipe({"imitate": {"learner": "bc", **tree}})


def test_trees_are_read_strictly():
    assert read(Outer, {"samples": 3, "inner": {"sizes": [1], "rate": 1}}) == Outer(3, inner=Inner(1.0, (1,)))
    assert merge({"a": {"b": 1, "c": 2}}, {"a": {"b": 3}}, {"d": 4}) == {"a": {"b": 3, "c": 2}, "d": 4}


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        ({"sample": 3}, r"unknown setting x\.sample \(in my\.toml\); known are: inner, name, samples, steps"),
        ({"inner": {"rats": 1}}, r"unknown setting x\.inner\.rats"),
        ({"samples": "3"}, r"x\.samples = '3' \(in my\.toml\) cannot be: Expected `int`"),
        ({"samples": 1.5}, "cannot be"),
        ({"samples": True}, "cannot be"),
        ({"samples": 0}, r"x\.samples is 0; give 1 to"),
        ({"steps": 10}, r"x\.steps is 10; give 1 to 9"),
        ({"inner": {"rate": float("nan")}}, r"x\.inner\.rate is nan; give a finite number"),
        ({"inner": {"rate": 1.5}}, r"x\.inner\.rate is 1\.5; give 0 to 1"),
        ({"inner": {"sizes": [1, -2]}}, "not negative"),
        ({"inner": 3}, "cannot be"),
    ],
)
def test_what_cannot_be_is_told(tree, said):
    with pytest.raises(BadSetting, match=said):
        read(Outer, tree, "x.", "my.toml")


def test_a_configuration_made_in_python_is_checked_too():
    with pytest.raises(BadSetting, match=r"inner\.rate is inf"):
        check(Outer(inner=Inner(float("inf"))))
    with pytest.raises(BadSetting, match=r"objects\.count is 0"):
        check_recipe(Recipe(objects=ObjectsConfig(count=0)))


# --- recipes


def test_values_come_from_defaults_presets_a_file_and_the_command_line(tmp_path):
    path = tmp_path / "my.toml"
    path.write_text('preset = "smoke"\nseed = 4\n[references]\ncount = 5\n[track.ppo]\nlearning_rate = 3e-4\n')
    words = ["--config", str(path), "--task", "lie-bed", "--track.ppo.gamma", "0.9", "--samples", "7"]
    (recipe,) = read_call("track", words).recipes
    assert (recipe.task, recipe.seed, recipe.robot) == ("lie-bed", 4, "h1")
    assert recipe.objects == ObjectsConfig(count=16) and recipe.references == ReferencesConfig(count=5)
    assert recipe.track is not None and recipe.retarget == RetargetConfig()
    assert (recipe.track.ppo.learning_rate, recipe.track.ppo.gamma, recipe.track.samples) == (3e-4, 0.9, 7)
    assert recipe.evaluate.episodes == 16, "what later stages are told is kept"
    (recipe,) = read_call("track", [*words, "--seed", "5", "--track.ppo.learning-rate", "2e-4"]).recipes
    assert recipe.seed == 5 and recipe.track is not None and recipe.track.ppo.learning_rate == 2e-4


def test_which_settings_there_are_follows_from_the_learner(tmp_path):
    path = tmp_path / "act.toml"
    path.write_text('[imitate]\nlearner = "act"\n[imitate.network]\nheads = 2\n')
    (recipe,) = read_call("imitate", ["--config", str(path), "--network.chunk", "7"]).recipes
    config = recipe.imitate
    assert isinstance(config, stage_type("imitate", {"learner": "act"})) and config.learner == "act"
    assert (config.network.heads, config.network.chunk) == (2, 7)
    (recipe,) = read_call("imitate", ["--learner", "planner", "--planner.samples", "9"]).recipes
    assert recipe.imitate is not None and recipe.imitate.planner.samples == 9


def test_help_documents_every_setting_of_every_stage(capsys):
    with pytest.raises(SystemExit):
        read_call("evaluate", ["--help"])
    shown = capsys.readouterr().out
    for part in ("objects", "references", "retarget", "track", "demos", "imitate", "evaluate"):
        for name in leaves(stage_type(part)(), f"--{part}"):
            assert name.replace("_", "-") in shown, name


def leaves(config, where):
    for name, value in vars(config).items():
        yield from leaves(value, f"{where}.{name}") if hasattr(value, "__dataclass_fields__") else [f"{where}.{name}"]


@pytest.mark.parametrize("task", list(TASKS))
@pytest.mark.parametrize("preset", list(PRESETS))
def test_every_preset_is_a_recipe_for_every_task(preset, task):
    recipe = read_recipe(recipe_tree([preset], None, {"task": task}))
    assert recipe.task == task


def test_the_paper_is_the_paper():
    recipe = read_recipe(preset_tree("paper", Chosen("sit-chair")))
    assert recipe.objects == ObjectsConfig(count=4600) and recipe.references == ReferencesConfig(count=5000)
    assert recipe.retarget == RetargetConfig("optimization", "paper")
    assert recipe.track is not None and recipe.track.tracking.ends.max_pos_error == 0.5
    assert recipe.track.tracking.focus == recipe.track.tracking.hold == recipe.track.tracking.push == 0, "ours"
    assert (recipe.track.num_envs, recipe.track.ppo.steps, recipe.track.ppo.epochs) == (
        2048,
        32,
        2,
    ) and recipe.track.tracker == "hst"


@pytest.mark.parametrize("task", list(TASKS))
def test_the_papers_tracker_is_trained_as_it_says(task):
    track = read_recipe(preset_tree("paper", Chosen(task))).track
    assert track is not None and TRACKERS.get(track.tracker).gains == "paper", "100 and 5 at every joint"
    ppo, ends = track.ppo, track.tracking.ends
    assert (ppo.gamma, ppo.lam, ppo.clip, ppo.entropy, ppo.minibatches) == (0.99, 0.95, 0.2, 1e-5, 4)
    assert (ppo.learning_rate, ppo.schedule, ppo.optimizer, ppo.hidden) == (1e-4, "fixed", "adamw", (512,) * 3)
    assert ends.max_pos_error == ends.max_drop == 0.5
    assert min(ends.max_angle_error, ends.max_ankle_error, ends.max_object_error) > 100, "it asks nothing else"
    # beside itself and its reference: the two targets where there are some, the object where it moves
    told = {term.name for term in chosen_terms(TRACKERS.get(track.tracker).observations, TASKS.get(task))}
    assert ("targets" in told, "object" in told) == (task == "touch-points", task == "lift-box")


def test_a_learner_without_its_tracker_is_told():
    @dataclass(frozen=True)
    class Stubborn(ImitateConfig):
        tracker: ClassVar[str | None] = "residual"

    check_recipe(Recipe(imitate=Stubborn()))
    with pytest.raises(BadSetting, match="needs the tracker 'residual', but track.tracker is 'hst'"):
        check_recipe(Recipe(imitate=Stubborn(), track=TrackConfig(tracker="hst")))


def test_who_says_poses_drives_only_beside_clips():
    hit = read_recipe(recipe_tree([], None, {"imitate": {"learner": "hit"}})).imitate
    check_recipe(Recipe(imitate=hit, demos=DemosConfig()))
    check_recipe(Recipe(imitate=hit, demos=DemosConfig(expert="planner")))
    hit = replace(hit, dagger=replace(hit.dagger, rounds=1))
    check_recipe(Recipe(imitate=hit, demos=DemosConfig()))
    with pytest.raises(BadSetting, match="'hit' learns to say poses, and where it drives itself nobody shows it any"):
        check_recipe(Recipe(imitate=hit, demos=DemosConfig(expert="planner")))
    check_recipe(Recipe(imitate=ImitateConfig(), demos=DemosConfig(expert="planner")))


@pytest.mark.parametrize(("learner", "network"), [("act", ACTConfig()), ("bc", BCConfig())])
def test_the_papers_learners_have_its_sizes_and_training(learner, network):
    for task, batches in (("sit-chair", 937_500), ("lift-box", 166_750)):
        tree = recipe_tree(["paper"], None, {"task": task, "imitate": {"learner": learner}})
        imitate = read_recipe(tree).imitate
        assert isinstance(imitate, CloneImitation) and imitate.network == network and imitate.learner == learner
        train = imitate.train
        assert (train.steps, train.batch, train.learning_rate, train.weight_decay) == (batches, 8, 1e-5, 1e-4)
        assert (train.schedule, train.warmup, train.clip, train.average) == ("constant", 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("learner", "network", "batch", "rate"),
    [("hit", HITConfig(), 48, 1e-5), ("diffusion", DiffusionConfig(), 64, 1e-4)],
)
def test_learners_of_other_sources_have_their_training(learner, network, batch, rate):
    imitate = read_recipe(recipe_tree(["paper"], None, {"task": "lie-bed", "imitate": {"learner": learner}})).imitate
    assert isinstance(imitate, CloneImitation) and imitate.network == network
    train = imitate.train
    assert (train.steps, train.batch, train.learning_rate, train.clip) == (100_000, batch, rate, 0.0)
    assert train.betas == ((0.95, 0.999) if learner == "diffusion" else (0.9, 0.999))


@pytest.mark.parametrize("said", ["3", '["ours", 3]', '[["ours"]]', "{ours = 1}"])
def test_presets_of_a_file_are_names(tmp_path, said):
    (tmp_path / "my.toml").write_text(f"preset = {said}")
    with pytest.raises(BadSetting, match=r"preset = .*my\.toml.* cannot be: give a preset's name"):
        recipe_tree([], tmp_path / "my.toml", {})


def test_a_file_may_begin_with_the_mark_of_an_editor(tmp_path):
    (tmp_path / "my.toml").write_bytes('\ufeff# Stühle\npreset = "smoke"\n'.encode())
    assert read_recipe(recipe_tree([], tmp_path / "my.toml", {})).references.count == 16
    with pytest.raises(BadSetting, match=r"unknown setting presets \(in my\.toml\); known are: preset, task"):
        read_recipe({"presets": ["smoke"]}, "my.toml")


def test_files_that_are_no_recipes(tmp_path):
    bad = {
        "cut.toml": "a = [",
        "word.toml": "objects = 3",
        "name.toml": "[object]\ncount = 3",
        "type.toml": '[objects]\ncount = "many"',
        "late.toml": "[track]\nrewards = 3",
        "class.toml": '[imitate]\nlearner = "bc"\ntracker = "residual"',
    }
    for name, text in bad.items():
        (tmp_path / name).write_text(text)
        with pytest.raises((BadFile, BadSetting)):
            read_recipe(recipe_tree([], tmp_path / name, {}))
    with pytest.raises(BadSetting) as caught:  # what all of a class share is no setting
        read_recipe(recipe_tree([], tmp_path / "class.toml", {}), "class.toml")
    told = str(caught.value)
    assert "unknown setting imitate.tracker (in class.toml)" in told and "tracker" not in told.partition("known are")[2]
    with pytest.raises(BadFile):
        recipe_tree([], tmp_path, {})
    with pytest.raises(UnknownName, match="unknown preset"):
        recipe_tree(["theirs"], None, {})
    with pytest.raises(BadSetting, match=r"evaluate\.split"):
        EvaluateConfig(split="all of them")


# --- stages


def test_recipes_share_what_they_have_in_common(tmp_path):
    ours = making.small(retarget=RetargetConfig(method="interaction"))
    other = replace(ours, retarget=making.QUICK)
    first, second = (making.make("references", tmp_path, recipe) for recipe in (ours, other))
    assert first.folder == second.folder and len(stages_of(tmp_path, "sit-chair", "references")) == 1
    both = [making.make("retarget", tmp_path, recipe) for recipe in (ours, replace(ours, retarget=RetargetConfig()))]
    assert both[0].folder == both[1].folder, "what is said and what is the default are one"
    third = making.make("objects", tmp_path, replace(ours, seed=1))
    assert third.folder.parent == making.make("objects", tmp_path).folder.parent != third.folder
    header = read_stage(both[0].folder).header
    assert header["recipe"]["references"]["count"] == 4 and header["recipe"]["retarget"]["method"] == "interaction"
    assert header["reads"]["objects"] == f"objects/{making.make('objects', tmp_path).folder.name}"


def test_a_count_is_raised_and_the_same_comes_out_as_in_one_go(tmp_path):
    grown, whole = tmp_path / "grown", tmp_path / "whole"
    few = making.make("retarget", grown, making.small(clips=3))
    stamps = {path.name: path.stat().st_mtime_ns for path in few.folder.glob("*.npz")}
    more = making.make("retarget", grown, making.small(clips=5))
    assert more.folder == few.folder and more.summary["clips"] == 5
    assert stamps == {name: (more.folder / name).stat().st_mtime_ns for name in stamps}, "and nothing is made twice"
    at_once = making.make("retarget", whole, making.small(clips=5))
    assert {p.name: p.read_bytes() for p in more.folder.glob("*.npz")} == {
        p.name: p.read_bytes() for p in at_once.folder.glob("*.npz")
    }
    again = making.make("retarget", grown, making.small(clips=3))
    assert again.summary == few.summary and again.fingerprint == few.fingerprint
    assert read_stage(more.folder).summary["clips"] == 5


def test_clips_on_other_objects_are_other_clips(tmp_path):
    one = making.make("references", tmp_path, making.small(objects=3))
    other = making.make("references", tmp_path, making.small(objects=4))
    assert one.folder != other.folder, "which object a clip is on depends on how many there are"


def test_a_toml_recipe_end_to_end(tmp_path, monkeypatch, capsys):
    """Objects, clips, retargeting, tracker, perception, a planner, and its rows, each as small as can be;
    then with one setting changed.
    """
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.toml").write_text(TINY)
    cli.main(["imitate", "--config", "tiny.toml", "--workers", "1", "--json"])
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["stage"] == "imitate" and told["samples"] == 32 and told["clips"] >= 1
    folder = tmp_path / told["folder"]
    assert {path.name for path in folder.iterdir()} >= {"header.json", "policy", "tracker", "perception"}
    recipe = json.loads((folder / "header.json").read_text())["recipe"]
    assert recipe["imitate"]["planner"]["samples"] == 32 and recipe["track"]["samples"] == 30_000_000
    words = ["evaluate", "--config", "tiny.toml", "--policy", "planner", "--episodes", "2", "--workers", "1", "--json"]
    cli.main(words)
    assert json.loads(capsys.readouterr().out)["episodes"] == 2
    (path,) = tmp_path.glob("work/sit-chair/evaluate/planner-*.parquet")
    stamp = path.stat().st_mtime_ns
    cli.main(words)
    assert path.stat().st_mtime_ns == stamp, "what has been judged is not judged again"
    cli.main(["imitate", "--config", "tiny.toml", "--workers", "1", "--json", "--planner.learning-rate", "2e-3"])
    other = json.loads(capsys.readouterr().out.splitlines()[-1])["folder"]
    assert other != told["folder"] and len(stages_of(tmp_path / "work", "sit-chair", "imitate")) == 2
    assert len(stages_of(tmp_path / "work", "sit-chair", "perception")) == 1, "what they share is made once"


TINY = """
preset = "ours"
seed = 1
objects = { count = 8 }
references = { count = 6 }
retarget = { method = "copy-rotation" }

[imitate]
learner = "planner"
perception = { maps = 8, steps = 2, batch = 4 }
planner = { samples = 32, num_envs = 4, steps = 4, batches = 1, batch = 8, memory = 64 }
"""


# --- rows


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """A recipe whose tracker has been judged on two clips."""
    workdir = tmp_path_factory.mktemp("judged")
    recipe = making.small(objects=8, evaluate=EvaluateConfig(tracked=2, episodes=2))
    run = start(recipe, workdir, making.QUIET)
    judge(run, "tracker")
    return run


def test_rows_say_what_they_are_of(judged):
    (path,) = judged.workdir.glob("sit-chair/evaluate/*.parquet")
    source = rows_made_from(path)
    assert source["episodes"] == len(read_rows(path)) == 2 and source["split"] == "test"
    assert {"checkpoint", "clips", "protocol", "seed", "mimicbench", "mujoco"} <= source.keys()
    assert {row.split for row in read_rows(path)} == {"test"}
    assert path.name == rows_path(judged, WhoIs("tracker"), {k: v for k, v in source.items() if k != "episodes"}).name


@dataclass(frozen=True)
class WhoIs:
    name: str


def test_fewer_episodes_do_not_replace_more_and_more_do(judged):
    (path,) = judged.workdir.glob("sit-chair/evaluate/*.parquet")
    asked = lambda count: replace(judged, recipe=replace(judged.recipe, evaluate=EvaluateConfig(tracked=count)))  # noqa: E731
    assert len(judge(asked(1), "tracker")) == 1 and len(read_rows(path)) == 2
    assert len(judge(asked(3), "tracker")) == 3 and len(read_rows(path)) == 3


def test_clips_of_more_episodes_are_not_looked_through_again_for_fewer(tmp_path, capfd):
    run = start(making.small(objects=8), tmp_path, RunContext(workers=1))
    more = episodes_of(run, 4)
    assert "human clips" in capfd.readouterr().err
    fewer = episodes_of(run, 2)
    assert not capfd.readouterr().err
    assert [clip.id for clip in fewer.set.motions] == [clip.id for clip in more.set.motions[:2]]
    alone = episodes_of(replace(run, workdir=tmp_path / "alone"), 2)
    assert [clip.id for clip in alone.set.motions] == [clip.id for clip in fewer.set.motions]


def test_who_is_stopped_goes_on_after_the_last_whole_batch(judged, tmp_path):
    """The rows are those of one go, and what is there is not run again: it is shown by a distance that nobody ran."""
    batch = Protocol(batch=2)
    asked = lambda count: replace(  # noqa: E731
        judged, workdir=tmp_path, recipe=replace(judged.recipe, evaluate=EvaluateConfig(tracked=count))
    )
    at_once = judge(asked(4), "tracker", batch)
    (path,) = tmp_path.glob("sit-chair/evaluate/*.parquet")
    source = rows_made_from(path)
    marked = [replace(row, end_distance=77.0) for row in at_once]
    write_rows(path, marked[:3], {**source, "episodes": 3})
    assert judge(asked(4), "tracker", batch) == marked[:2] + at_once[2:] == read_rows(path)
    assert rows_made_from(path) == source
    # what failed for a moment's reason is tried again, from its batch on
    late = [*marked[:3], replace(marked[3], error="act took more than 300 s")]
    write_rows(path, late, source)
    assert judge(asked(4), "tracker", batch) == marked[:2] + at_once[2:] == read_rows(path)


SEES_ROWS = """
import torch
from pathlib import Path

class SeesRows:
    # fails where rows of the episodes before these are not yet there
    observations, gains, begun = ("proprio",), "improved", 0

    def to(self, device):
        pass

    def reset(self, ids, obs):
        assert len(list(Path(__file__).parent.glob("work/sit-chair/evaluate/*.parquet"))) == (self.begun > 0)
        self.begun += 1

    def act(self, obs):
        return torch.zeros(obs.num_envs, 19)

make_policy = SeesRows
"""


def test_rows_of_a_batch_are_kept_as_soon_as_it_is_over(judged, tmp_path):
    (tmp_path / "sees.py").write_text(SEES_ROWS)
    rows = judge(replace(judged, workdir=tmp_path / "work"), str(tmp_path / "sees.py"), Protocol(batch=1))
    assert [row.error for row in rows] == ["", ""]


ODD = """
from pathlib import Path
import torch

class Odd:
    observations, gains = ("proprio",), "improved"

    def to(self, device):
        self.left = int(Path(__file__).with_suffix(".txt").read_text())

    def reset(self, ids, obs):
        pass

    def act(self, obs):
        self.left -= 1
        assert self.left >= 0, "tired"
        return torch.zeros(obs.num_envs, 19)

make_policy = Odd
"""


def test_motions_of_an_earlier_run_are_not_beside_new_rows(judged, tmp_path):
    policy = tmp_path / "odd.py"
    policy.write_text(ODD)

    def after(steps):
        policy.with_suffix(".txt").write_text(str(steps))
        rows = judge(judged, str(policy))
        (folder,) = judged.workdir.glob("sit-chair/evaluate/odd-*.parquet")
        motions = {path.stem: RobotMotion.load(path) for path in folder.with_suffix("").glob("*.npz")}
        assert [row.steps for row in rows] == [steps, steps] and motions.keys() <= {row.id for row in rows}
        return [motion.frames for motion in motions.values()]

    first = after(4)
    assert len(first) == 2
    again = after(2)
    assert len(again) == 2 and max(again) < min(first)
    assert after(0) == [], "who gives up at once leaves nothing to be seen, and nothing of before either"


def test_fewer_episodes_of_a_program_do_not_replace_more(judged, tmp_path):
    policy = tmp_path / "odd_too.py"
    policy.write_text(ODD)
    policy.with_suffix(".txt").write_text("4")
    judge(judged, str(policy))
    (path,) = judged.workdir.glob("sit-chair/evaluate/odd_too-*.parquet")
    one = replace(judged, recipe=replace(judged.recipe, evaluate=EvaluateConfig(episodes=1)))
    before = sorted(path.with_suffix("").iterdir())
    policy.with_suffix(".txt").write_text("2")
    rows = judge(one, str(policy))
    assert len(rows) == 1 and len(read_rows(path)) == 2
    # what is shown is of these rows, and what is kept of those
    ((row, motion),) = episodes_to_show(one, str(policy), episodes_of(one, 1), rows)
    kept = RobotMotion.load(path.with_suffix("") / f"{row.id}.npz")
    assert row == rows[0] and row.steps == 2 and motion.frames == kept.frames - 2
    assert sorted(path.with_suffix("").iterdir()) == before


def test_a_program_that_always_fails_ends_with_an_error(judged, tmp_path):
    policy = tmp_path / "tired.py"
    policy.write_text(ODD)
    policy.with_suffix(".txt").write_text("0")
    rows = judge(judged, str(policy))
    assert len(rows) == 2
    with pytest.raises(MimicbenchError, match=r"tired failed in all of 2 episodes: .*tired.*; mend it first"):
        check_acted(rows)
    check_acted([*rows, replace(rows[0], error="")])


def test_who_fails_leaves_the_others_their_results(judged, tmp_path, capsys):
    for name, steps in (("weary", 0), ("lasting", 2000)):
        (tmp_path / f"{name}.py").write_text(ODD)
        (tmp_path / f"{name}.txt").write_text(str(steps))
    (tmp_path / "empty.py").write_text("")
    policies = [str(tmp_path / f"{name}.py") for name in ("weary", "empty", "lasting")]
    words = "--objects.count 8 --references.count 4 --retarget.method copy-rotation --episodes 2 --workers 1 --workdir"
    with pytest.raises(MimicbenchError, match=r"weary failed in all of 2 episodes: act raised .*; .*empty\.py"):
        cli._call(["evaluate", *words.split(), str(judged.workdir), "--policy", *policies])
    told = capsys.readouterr().out
    assert "lasting" in told and "weary" not in told


def test_rows_of_another_network_or_other_clips_are_others(judged, tmp_path):
    before = set(judged.workdir.glob("sit-chair/evaluate/*.parquet"))
    other = replace(judged, recipe=replace(judged.recipe, seed=2))
    judge(other, "tracker")
    assert len(set(judged.workdir.glob("sit-chair/evaluate/*.parquet")) - before) == 1


def test_too_few_clips_for_the_episodes_are_told(judged):
    few = replace(judged, recipe=replace(judged.recipe, evaluate=EvaluateConfig(tracked=50, split="train")))
    with pytest.raises(
        MimicbenchError, match=r"of the split 'train' that fulfil K, not 50; .* take another split \(--split all\)"
    ):
        judge(few, "tracker")


def test_three_lines(tmp_path):
    run_stage("retarget", making.small(), tmp_path / "work", making.QUIET)
    (stage,) = stages_of(tmp_path / "work", "sit-chair", "retarget")
    assert stage.complete and np.isfinite(stage.summary["rate"])
    with pytest.raises(UnknownName, match="unknown stage 'dance'"):
        run_stage("dance", Recipe(), tmp_path)


# --- trackers of several tasks


def test_a_tracker_of_several_tasks_reads_the_clips_of_all(tmp_path):
    tree = {"task": "sit-chair", "track": {"also": ["lift-box", "touch-points"]}}
    alone, together = (start(read_recipe(part), tmp_path) for part in ({"task": "sit-chair"}, tree))
    assert list(keys.tracked(together)) == ["sit-chair", "lift-box", "touch-points"]
    ours, key = keys.track_key(alone), keys.track_key(together)
    assert key.digest != ours.digest and set(key.reads) == {"retarget", "lift-box", "touch-points"}
    assert key.reads["retarget"] == ours.reads["retarget"]
    assert key.reads["lift-box"].parent == tmp_path / "lift-box" / "retarget"


@pytest.mark.parametrize(
    ("track", "said"),
    [
        ({"also": ["sit-chair"]}, "name each task beside 'sit-chair' once"),
        ({"also": ["lift-box", "lift-box"]}, "name each task beside 'sit-chair' once"),
        ({"also": ["fly"]}, "unknown task 'fly'"),
        ({"also": ["lift-box"], "shares": [1, 2, 3]}, "track.shares has 3 numbers for 2 tasks"),
        ({"begin_from": "nowhere"}, "track.begin_from is 'nowhere', where no tracker is"),
        ({"teachers": ["nowhere"]}, "track.teachers names .nowhere., where no tracker is"),
        ({"also": ["lift-box"], "teachers": ["a"]}, "track.teachers are 1 for 2 tasks"),
    ],
)
def test_trackers_that_cannot_be_trained_are_refused_at_once(track, said):
    with pytest.raises(MimicbenchError, match=said):
        read_recipe({"task": "sit-chair", "track": track})


def test_a_planner_of_several_tasks_reads_clips_and_eyes_of_all(tmp_path):
    """And learns over the shipped tracker of all tasks, where a planner of one takes that of its task."""

    def run(**more):
        imitate = {"learner": "planner", "planner": {"clock": False}, **more}
        return start(read_recipe({"task": "lift-box", "imitate": imitate}), tmp_path)

    alone, together = run(), run(also=["sit-chair", "touch-points"])
    trackers = [keys.tracker_folder(one) for one in (alone, together)]
    assert trackers == [SHIPPED / "lift-box" / "tracker", SHIPPED / "tracker"]
    ours, key = (keys.imitate_key(one, trackers[1]) for one in (alone, together))
    assert "also" not in ours.settings, "without other tasks it is what it was before there could be any"
    more = {"retarget/sit-chair", "retarget/touch-points", "sit-chair/perception"}  # what is told needs no eyes
    assert set(key.reads) - set(ours.reads) == more and key.reads["retarget"] == ours.reads["retarget"]
    assert key.reads["retarget/sit-chair"].parent == tmp_path / "sit-chair" / "retarget"
    turned = keys.imitate_key(run(also=["touch-points", "sit-chair"]), trackers[1])
    assert turned.digest != key.digest, "the order of tasks is that of the network's columns"


def test_a_planner_learns_from_recordings_beside_clips_that_are_made(tmp_path):
    tree = {"task": "sit-chair", "imitate": {"learner": "planner", "recorded": ["people"]}}
    run = start(read_recipe(tree), tmp_path)
    with pytest.raises(BadFile, match="mimicbench import FILE --to people"):
        keys.imitate_key(run, SHIPPED / "tracker")
    for kind in ("objects", "references"):
        with making.by_hand(tmp_path / "sit-chair" / kind / "people", kind) as stage:
            stage.finish()
    assert list(keys.learned(run)) == ["sit-chair", "sit-chair/people"]
    key = keys.imitate_key(run, SHIPPED / "tracker")
    assert set(key.reads) == {"tracker", "retarget", "retarget/sit-chair/people", "perception"}
    assert key.settings["recorded"] == ["people"] and key.words == ("planner", "people")


@pytest.mark.parametrize(
    ("also", "said"),
    [(["sit-chair"], "name each task beside 'sit-chair' once"), (["fly"], "unknown task 'fly'")],
)
def test_planners_of_tasks_that_are_not_there_are_refused_at_once(also, said):
    with pytest.raises(MimicbenchError, match=said):
        read_recipe({"imitate": {"learner": "planner", "planner": {"clock": False}, "also": also}})


def test_a_cloner_that_begins_where_no_policy_is_is_refused_at_once():
    with pytest.raises(BadSetting, match="imitate.begin_from is 'nowhere', where no policy is"):
        read_recipe({"task": "sit-chair", "imitate": {"learner": "act", "begin_from": "nowhere"}})
    with pytest.raises(BadSetting, match="imitate.dagger.rounds-of names 'nowhere', beside which no rounds are"):
        read_recipe({"task": "sit-chair", "imitate": {"learner": "act", "dagger": {"rounds_of": ["nowhere"]}}})


def test_recordings_to_learn_from_must_be_there(tmp_path):
    run = start(read_recipe({"task": "sit-chair", "track": {"recorded": ["people"]}}), tmp_path)
    with pytest.raises(BadFile, match="mimicbench import FILE --to people"):
        keys.tracked(run)


@pytest.mark.parametrize("profile", ["smoke", "default", "full"])
@pytest.mark.parametrize("task", list(TASKS))
def test_sizes_name_policies_that_are_shipped_and_can_be_learned(task, profile):
    """`run --train` learns whom a size names, all others judge what is shipped, and nobody is judged twice."""
    recipe = read_call("evaluate", ["--task", task], presets=[profile]).recipes[0]
    names = recipe.evaluate.policy
    assert names[0] == "tracker" and len(names) > 1 and len(set(names)) == len(names)
    for name in names[1:]:
        stage_type("imitate", {"learner": name})
        assert (SHIPPED / task / name / CONFIG).exists(), name


def test_the_presets_of_a_file_say_how_much_a_run_does(tmp_path):
    """As those of the command line do; only who asks for a profile gets that instead."""
    path = tmp_path / "my.toml"
    path.write_text('preset = "smoke"\n[objects]\ncount = 9\n')

    def sizes(*words):
        call, _, _ = read_run(words)
        recipe = call.recipes[0]
        return recipe.seed, recipe.objects.count, recipe.references.count, recipe.evaluate.episodes

    assert sizes() == (1, 120, 128, 128)
    assert sizes("--config", str(path)) == (1, 9, 16, 16), "its own settings last"
    assert sizes("--preset", "smoke") == (1, 16, 16, 16)
    assert sizes("--config", str(path), "--train") == (0, 9, 16, 16)
    assert sizes("--config", str(path), "--profile", "full") == (1, 9, 2000, 400)
    assert sizes("--config", str(path), "--preset", "default") == (1, 9, 128, 128)


@pytest.mark.parametrize("task", list(TASKS))
def test_what_is_learned_briefly_is_what_is_judged(task):
    """`run --train --profile smoke` is over in minutes: every training that it begins is brief."""
    recipe = read_call("evaluate", ["--task", task], presets=["smoke", "brief"]).recipes[0]
    assert recipe.track is not None and recipe.track.samples == 100_000
    assert recipe.imitate is not None and recipe.imitate.perception.steps == 200
    assert recipe.evaluate.policy == ("tracker", recipe.imitate.learner)


@pytest.mark.parametrize("learner", list(LEARNERS))
def test_a_brief_training_is_less_of_the_same(learner):
    less = dict(preset_tree("brief", Chosen("sit-chair", learner))["imitate"])
    assert less.pop("learner") == learner

    def check_less(tree, usual):
        for name, value in tree.items():
            if isinstance(value, dict):
                check_less(value, getattr(usual, name))
            else:
                assert value < getattr(usual, name) / 10

    check_less(less, stage_type("imitate", {"learner": learner})())
    own = {entry.name for entry in fields(stage_type("imitate", {"learner": learner}))}
    assert {"planner", "train", "samples"} & own == set(less) - {"perception"}, "whatever it trains is brief"
