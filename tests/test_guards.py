"""What numbers rest on and one changed line would undo without a sound: who learns from what, who is judged on what."""

import json
import shutil
from dataclasses import fields, replace

import numpy as np
import pytest
import safetensors
import torch

import making
from mimicbench.benchmark import keys
from mimicbench.benchmark import shipped as shipped_there
from mimicbench.benchmark.graph import _tell_tracker, retargeted, start, tracker_for_learning
from mimicbench.benchmark.judging import _of_split, _tell_of_others, _warn_of_other_task, judge
from mimicbench.benchmark.recipe import EvaluateConfig, stage_type
from mimicbench.benchmark.who import who_of
from mimicbench.commands.judge import _each_once
from mimicbench.core.checkpoint import CONFIG
from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName
from mimicbench.core.files import read_record, write_record
from mimicbench.core.run import RunContext
from mimicbench.core.stage import StageKey, opened
from mimicbench.core.training import STATE
from mimicbench.envs.metrics import Verdict
from mimicbench.evaluate.rows import read_rows, rows_made_from
from mimicbench.imitate.demos import batches, demonstrations
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.objects.make import ObjectsConfig
from mimicbench.objects.shape import split_of
from mimicbench.references.checks.quality import Limits, faults
from mimicbench.references.settings import ReferencesConfig
from mimicbench.retarget.acceptance import PROMISED, outcome, summary, unsolved
from mimicbench.retarget.acceptance import Limits as Solved
from mimicbench.retarget.settings import RetargetConfig
from mimicbench.tasks.registry import TASKS
from mimicbench.track.learning.ppo import PPOConfig
from mimicbench.track.rollout import Recording, Rollout
from mimicbench.track.settings import TrackConfig

TINY = TrackConfig(
    samples=16, num_envs=4, parts=1, evaluate_clips=1, threads=1, ppo=PPOConfig(hidden=(8,), steps=4, minibatches=2)
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recipe with clips on objects of both splits."""
    # a method that keeps every clip
    method = RetargetConfig("optimization")
    recipe = making.small(objects=8, clips=8, retarget=method, evaluate=EvaluateConfig(episodes=2, tracked=2))
    found = start(recipe, tmp_path_factory.mktemp("guards"), making.QUIET)
    splits = [obj.split for obj in retargeted(found).set.scenes]
    assert {"train", "test"} == set(splits)
    return found


def with_evaluation(run, **changes):
    return run.changed(evaluate=replace(run.recipe.evaluate, **changes))


# --- who is judged on what


def test_rows_that_are_damaged_are_made_again(run):
    rows = judge(run, keys.TRACKER)
    (path,) = (run.workdir / run.recipe.task / "evaluate").glob("tracker-*.parquet")
    whole = path.read_bytes()
    path.write_bytes(whole[:20] + bytes(20) + whole[40:])
    assert rows_made_from(path)["episodes"] == len(rows), "what it is made from can be read"
    with pytest.raises(BadFile):
        read_rows(path)
    assert judge(run, keys.TRACKER) == rows and path.read_bytes() == whole


@pytest.mark.parametrize("split", ["test", "train"])
def test_episodes_are_on_objects_of_their_split(run, split):
    assert EvaluateConfig().split == "test"
    of_split = with_evaluation(run, split=split)
    found = _of_split(of_split, None)
    assert len(found.set) and {obj.split for obj in found.set.scenes} == {split}
    assert {row.split for row in judge(with_evaluation(run, split=split, tracked=1), "tracker")} == {split}


def test_clips_for_an_evaluation_are_not_those_of_a_training(run):
    theirs = _of_split(run, 3)
    assert {obj.split for obj in theirs.set.scenes} == {"test"} and theirs.stage.folder != retargeted(run).stage.folder


def test_a_tracker_is_judged_by_its_kind_not_by_its_name(run, tmp_path, monkeypatch):
    shipped = who_of(run, "tracker").folder
    monkeypatch.setattr(shipped_there, "SHIPPED", tmp_path)
    shutil.copytree(shipped, tmp_path / "sit-chair" / "another")
    first, *_ = by_name = judge(with_evaluation(run, tracked=1, episodes=9), "another")
    assert (first.stage, first.policy) == ("track", "another") and len(by_name) == 1
    assert judge(with_evaluation(run, tracked=1), str(tmp_path / "sit-chair" / "another")) == by_name
    with pytest.raises(UnknownName, match="no-such"):
        who_of(run, "no-such")
    shutil.copytree(shipped.parent / "hst", tmp_path / "tracker")
    other = judge(with_evaluation(run, tracked=1), str(tmp_path / "tracker"))
    assert [row.policy for row in other] == ["hst"], "another design is another method, whatever its folder is called"


def test_who_was_learned_at_another_task_is_judged_with_a_warning(run, tmp_path):
    said, folder = [], tmp_path / "tracker"
    shutil.copytree(who_of(run, "tracker").folder, folder)
    told = replace(with_evaluation(run, tracked=1), context=replace(making.QUIET, say=said.append))

    def with_notes(**notes):
        write_record(folder / CONFIG, {**read_record(folder / CONFIG), "notes": notes})

    with_notes(tasks=["lie-bed", "lie-sofa"])
    warning = "warning: tracker was learned at lie-bed and lie-sofa, and is judged at sit-chair"
    assert len(judge(told, str(folder))) == 1 and said == [warning]
    assert judge(told, str(folder)) and said == [warning] * 2, "also of rows that are there already"
    for notes in ({"tasks": ["lie-bed", "sit-chair"]}, {"task": "sit-chair"}, {}, {"tasks": "lie-bed"}):
        with_notes(**notes)
        _warn_of_other_task(told, who_of(told, str(folder)))
    assert len(said) == 2


def test_a_checkpoint_is_named_from_within(run, monkeypatch):
    shipped = shipped_there.shipped("h1", "sit-chair", "bc")
    monkeypatch.chdir(shipped)
    assert who_of(run, ".") == who_of(run, "../bc") == who_of(run, str(shipped))
    assert who_of(run, "./..//bc/").name == "bc"


def test_a_run_has_each_policy_once(run, tmp_path):
    named = lambda *names: run.changed(evaluate=EvaluateConfig(policy=names))  # noqa: E731
    best = who_of(run, "best").name
    assert _each_once(named("best", "bc", best), False).recipe.evaluate.policy == ("best", "bc")
    assert _each_once(named("bc", "tracker", "bc"), True).recipe.evaluate.policy == ("bc", "tracker")
    shutil.copytree(who_of(run, "bc").folder, tmp_path / "bc")
    with pytest.raises(MimicbenchError, match="are both called 'bc' in rows and tables"):
        _each_once(named("bc", str(tmp_path / "bc")), False)


@pytest.mark.parametrize("task", TASKS)
def test_the_best_is_one_that_comes_with_the_package(task, run):
    best = who_of(run.changed(task=task), "best")
    assert best.folder == shipped_there.shipped("h1", task, best.name)


def test_rows_follow_the_clips_and_who_is_judged(run, tmp_path):
    first = judge(run, "tracker")
    files = set(run.workdir.glob("sit-chair/evaluate/tracker-*.parquet"))
    other = run.changed(retarget=RetargetConfig("copy-rotation"))
    judge(other, "tracker")
    more = set(run.workdir.glob("sit-chair/evaluate/tracker-*.parquet")) - files
    assert len(more) == 1, "the same seed, count and tracker, but other clips"
    assert judge(run, "tracker") == first
    own = tmp_path / "tracker"
    own.mkdir()
    for name in ("config.json", "model.safetensors"):
        (own / name).write_bytes((who_of(run, "tracker").folder / name).read_bytes())
    same = who_of(run, str(own)).digests
    config = json.loads((own / "config.json").read_text())
    config["notes"]["samples"] = 1
    config.pop("digest", None)
    (own / "config.json").write_text(json.dumps(config))
    assert who_of(run, str(own)).digests != same


def test_what_is_learned_follows_the_tracker(run, tmp_path):
    """A tracker that was trained anew is another one, wherever it is; so are demonstrations and policies of it."""
    shipped = who_of(run, "tracker").folder
    same, other = tmp_path / "same", tmp_path / "other"
    for copy in (same, other):
        shutil.copytree(shipped, copy)
    with open(other / "model.safetensors", "ab") as stream:
        stream.write(b" ")
    assert keys.demo_key(run, shipped).digest == keys.demo_key(run, same).digest != keys.demo_key(run, other).digest
    for learner in ("planner", "bc-clock"):
        one = run.changed(imitate=stage_type("imitate", {"learner": learner})())
        first, again, third = (keys.imitate_key(one, tracker).digest for tracker in (shipped, same, other))
        assert first == again != third


def test_demonstrations_follow_who_demonstrates(run, tmp_path):
    """A policy, its tracker and its eyes: who has learned anew, demonstrates anew."""
    shipped, planner = who_of(run, "tracker").folder, shipped_there.shipped("h1", "sit-chair", "planner")
    by_name = run.changed(demos=DemosConfig(expert="planner"))
    key = keys.demo_key(by_name, shipped)
    assert key.digest != keys.demo_key(run, shipped).digest
    assert {"expert_checkpoint", "expert_tracker", "expert_perception"} <= set(key.reads)
    copy = tmp_path / "sit-chair" / "planner"
    shutil.copytree(planner.parent, copy.parent)
    elsewhere = run.changed(demos=DemosConfig(expert=str(copy)))
    assert keys.demo_key(elsewhere, shipped).digest == key.digest
    with open(copy.parent / "tracker" / "model.safetensors", "ab") as stream:
        stream.write(b" ")
    assert keys.demo_key(elsewhere, shipped).digest != key.digest
    # who learned several tasks has its eyes of each in a folder of that task's name
    shutil.copytree(planner.parent.parent / "planner-six", tmp_path / "six" / "planner-six")
    shutil.copytree(planner.parent.parent / "tracker", tmp_path / "six" / "tracker")
    several = run.changed(demos=DemosConfig(expert=str(tmp_path / "six" / "planner-six")))
    before = keys.demo_key(several, shipped)
    assert "expert_sit-chair/perception" not in before.reads, "there are none here"
    its = tmp_path / "six" / "sit-chair" / "perception"
    shutil.copytree(planner.parent.parent / "sit-chair" / "perception", its)
    sees = keys.demo_key(several, shipped)
    assert "expert_sit-chair/perception" in sees.reads
    with open(its / "model.safetensors", "ab") as stream:
        stream.write(b" ")
    assert len({key.digest for key in (before, sees, keys.demo_key(several, shipped))}) == 3
    with pytest.raises(BadFile, match="demos.expert is 'nobody', where no policy is; give `tracker`, the name of"):
        keys.demo_key(run.changed(demos=DemosConfig(expert="nobody")), shipped)
    published = run.changed(demos=DemosConfig(source="theirs", expert="nobody"))
    assert keys.expert_folder(published, shipped) == shipped, "of a named set, all other settings are without effect"


def test_who_is_judged_by_a_name_that_others_of_the_workdir_have_is_told(tmp_path):
    said = []
    there = start(making.small(), tmp_path, RunContext(1, quiet=True, say=said.append))
    bc = who_of(there, "bc")
    _tell_of_others(there, bc, "bc")
    assert not said
    folder = tmp_path / "sit-chair" / "imitate" / "bc-0123abcd"
    with opened(folder, StageKey("imitate", "sit-chair", 0, {})) as stage:
        stage.finish()
    _tell_of_others(there, bc, "bc")
    assert said.pop().startswith(f"judging the shipped bc; {folder} is of other settings")
    with opened(tmp_path / "sit-chair" / "track" / "hst-0123abcd", StageKey("track", "sit-chair", 0, {})) as stage:
        stage.finish()
    _tell_of_others(there, who_of(there, "tracker"), "tracker")
    assert said.pop().endswith(f"--policy {stage.folder / 'checkpoint'}")
    assert not said
    _tell_of_others(there, who_of(there, "planner"), "planner")
    _tell_of_others(there, who_of(there, str(bc.folder)), str(bc.folder))
    assert not said


def test_whose_tracker_is_taken_or_that_one_is_to_be_trained_is_told(tmp_path):
    said = []
    recipe = making.small(imitate=stage_type("imitate", {"learner": "bc-clock"})())
    there = start(recipe, tmp_path, RunContext(1, quiet=True, say=said.append))
    _tell_tracker(there)
    assert said == [] and tracker_for_learning(there) == shipped_there.shipped_trackers("h1")["sit-chair"]
    assert said.pop() == "taking the shipped tracker of sit-chair; `mimicbench track` trains one here"
    tiny = there.changed(track=TINY)
    key = keys.track_key(tiny)
    folder = tiny.folder(key)
    with opened(folder, replace(key, amounts={**key.amounts, "samples": 4}), trained=True) as stage:
        (stage.folder / "checkpoint").mkdir()
        stage.finish()
    assert tracker_for_learning(tiny) == folder / "checkpoint"
    told = f"taking the tracker that was trained here for 4e-06 of {TINY.samples / 1e6:g} M samples; `mimicbench track`"
    assert said.pop().startswith(told) and not said
    shutil.rmtree(folder)
    _tell_tracker(tiny)
    assert said == [
        "no tracker of this recipe is here, nor one shipped for sit-chair: one is trained first, as by "
        f"`mimicbench track --task sit-chair --workdir {tmp_path}`"
    ]


# --- who learns from what


def test_trackers_learn_from_the_training_split_alone(run):
    from mimicbench.benchmark.graph import make_track_stage

    stage = make_track_stage(run.changed(track=TINY))
    with safetensors.safe_open(stage.folder / STATE, "pt") as file:
        learned = json.loads(file.metadata()["mimicbench"])["identity"]["clips"]
    clips = retargeted(run)
    of_split = {
        split: {m.id for m in clips.set.motions if split_of(m.object_id) == split} for split in ["train", "test"]
    }
    assert set(learned) == of_split["train"] and stage.summary["clips"] == len(learned)


def test_demonstrations_are_what_fulfilled_k_and_stays(run):
    clips = replace(retargeted(run).set, motions=retargeted(run).set.motions[:4])
    flags = {"success": [True, False, True, True], "stays": [True, True, False, True]}
    verdict = Verdict(**{f.name: torch.tensor(flags.get(f.name, [0] * 4)) for f in fields(Verdict)})
    pose = np.tile(np.r_[0.0, 0, 1, 1, 0, 0, 0, np.zeros(19)], (3, 1))
    kept = Recording([pose] * 4, [np.zeros((3, 25))] * 4, [np.zeros((3, 19))] * 4, [np.ones((3, 19))] * 4)
    made = list(demonstrations(Rollout(verdict, np.full(4, 3), kept), clips, 7))
    assert [demo.reference_id for demo in made] == [clips.motions[0].id, clips.motions[3].id]
    assert all(
        demo.success and demo.seed == 7 and demo.executed_action.all() and not demo.action.any() for demo in made
    )


@pytest.mark.parametrize(("share", "clean"), [(0.0, 0), (0.25, 2), (0.5, 4), (0.6, 5), (1.0, 8)])
def test_the_stated_share_of_demonstrations_is_without_noise(run, share, clean):
    clips = retargeted(run).set
    assert len(clips) == 8
    parts = batches(clips, DemosConfig(clean_share=share, action_noise=0.3, batch=3))
    assert [motion.id for part, _ in parts for motion in part.motions] == [motion.id for motion in clips.motions]
    assert all(1 <= len(part) <= 3 for part, _ in parts)
    undisturbed = [level for part, level in parts for _ in part.motions]
    assert undisturbed == [True] * clean + [False] * (8 - clean)


# --- what the gate lets pass


def measured():
    limits, found = Limits(), {}
    for entry in fields(Limits):
        limit = getattr(limits, entry.name)
        if isinstance(limit, tuple):
            found |= {f"{entry.name}_least": limit[0], f"{entry.name}_most": limit[1]}
        else:
            found[entry.name] = limit
    return found


def test_the_gate_lets_pass_what_is_at_its_limits_and_nothing_beyond():
    at_limits = measured()
    assert faults(at_limits) == []
    for name, limit in at_limits.items():
        beyond = limit - 1e-6 if name.endswith("_least") else limit + 1e-6
        assert faults({**at_limits, name: beyond}) == [name]


def test_the_gate_refuses_what_is_not_a_number():
    for name in measured():
        assert faults({**measured(), name: float("nan")}) == [name]


def test_the_limits_of_solved_clips_are_the_documented_ones():
    assert PROMISED.depth == PROMISED.step_skate == 0.04 and PROMISED.support_lost == 0.1
    assert PROMISED.lean_error == pytest.approx(0.1396, abs=1e-4), "8 degrees"
    given = Solved()
    assert (given.limit_violation, given.velocity_ratio, given.position_error, given.goal_error) == (0, 1, 0.25, 0.1)
    assert unsolved({}, given) == [] and unsolved({"limit_violation": 1e-9}, given) == ["limit_violation"]


def test_rates_of_a_set_count_every_clip():
    one = summary([outcome({}, True, 10, Solved())])
    assert (one.rate, one.k_rate, one.kept, one.fulfilled, one.frames) == (1, 1, 1, 1, 10)
    none = summary([])
    assert (none.rate, none.k_rate, none.clips) == (0, 0, 0)
    many = summary([outcome({"goal_error": 1.0}, k, 5, Solved()) for k in (True, False)])
    assert (many.k_rate, many.rate) == (0.5, 0) and list(many.rejected_for.items()) == [("goal_error", 2), ("K", 1)]
    tied = summary([outcome({"goal_error": 1.0, "position_error": 1.0}, False, 5, Solved())])
    assert list(tied.rejected_for) == ["K", "goal_error", "position_error"], "as many: by name"


def test_clips_of_a_set_are_on_the_objects_that_they_were_made_on(tmp_path):
    human, objects = making.make("references", tmp_path), making.make("objects", tmp_path)
    for stage, name in ((human, "references"), (objects, "objects")):
        shutil.copytree(stage.folder, tmp_path / "sit-chair" / name / "own")
    recipe = making.small(references=ReferencesConfig("own"), objects=ObjectsConfig("own"))
    assert making.make("retarget", tmp_path, recipe).summary["clips"] == 4
    shutil.rmtree(tmp_path / "sit-chair" / "objects" / "own")
    other = making.make("objects", tmp_path, making.small(seed=1))
    shutil.copytree(other.folder, tmp_path / "sit-chair" / "objects" / "own")
    with pytest.raises(BadFile, match="was made on other objects than"):
        making.make("retarget", tmp_path, recipe)
