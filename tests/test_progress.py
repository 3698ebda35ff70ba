"""What a training tells while it runs, on stderr and to TensorBoard; and scripts that start workers without a guard."""

import os
import subprocess
import sys

import pytest

import making
from mimicbench.benchmark import keys
from mimicbench.benchmark.graph import start
from mimicbench.benchmark.recipe import stage_type
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.core import progress
from mimicbench.core.events import EVENTS
from mimicbench.core.training import append_metrics, forget_after


def scalars(folder):
    """Every event of a folder as (step, {tag: value})."""
    from tensorboard.backend.event_processing.event_file_loader import LegacyEventFileLoader

    events = list(LegacyEventFileLoader(str(folder / EVENTS)).Load())
    assert events[0].file_version == "brain.Event:2"
    return [(e.step, {v.tag: round(v.simple_value, 4) for v in e.summary.value}) for e in events[1:]]


def test_tensorboard_reads_what_metrics_have(tmp_path):
    for step in (50, 100, 150):
        row = {
            "samples": step,
            "seconds": step / 10,
            "loss": 1 / step,
            "k": {"sit": 0.5},
            "none": None,
            "diverged": float("nan"),
        }
        append_metrics(tmp_path, row)
    found = scalars(tmp_path)
    assert found[1] == (100, {"seconds": 10.0, "loss": 0.01, "k/sit": 0.5}) and len(found) == 3
    with open(tmp_path / EVENTS, "ab") as stream:
        stream.write(b"\x08\x00")  # as if killed in the middle of a write
    forget_after(tmp_path / "metrics.jsonl", {"samples": 100})
    append_metrics(tmp_path, {"samples": 150, "seconds": 15.0, "loss": 0.5})
    assert [step for step, _ in scalars(tmp_path)] == [50, 100, 150]
    assert scalars(tmp_path)[-1][1]["loss"] == 0.5


def test_a_pulse_says_something_now_and_then():
    said = []
    often, seldom = progress.Pulse(said.append, 0.0), progress.Pulse(said.append, 1e6)
    often(lambda: "a")
    seldom(lambda: pytest.fail("not worked out"))
    often(lambda: "b")
    assert said == ["a", "b"] and progress.EVERY == 10


def test_a_log_gets_lines_and_no_bar(capsys, monkeypatch):
    monkeypatch.setattr(progress, "EVERY", 0.0)
    monkeypatch.setattr(progress.Pulse.__init__, "__defaults__", (0.0,))
    with progress.counter(3, "clips") as tick:
        for _ in range(3):
            tick(1, "loss 0.5")
    told = capsys.readouterr().err.splitlines()
    assert told == ["clips: 1/3, loss 0.5", "clips: 2/3, 0:00 left, loss 0.5", "clips: 3/3 in 0:00, loss 0.5"]
    with progress.counter(3, "clips", quiet=True) as tick:
        tick(3)
    assert capsys.readouterr().err == ""


def test_time_left_counts_neither_the_first_item_nor_what_an_earlier_run_did(capsys, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with progress.counter(1000, "batches") as tick:
        for seconds, count in ((60.0, 900), (10.0, 10), (10.0, 10)):
            now[0] += seconds
            tick(count)
    told = capsys.readouterr().err.splitlines()
    # ten items in ten seconds since the first call, eighty to go
    assert told[:3] == ["batches: 900/1000", "batches: 910/1000, 1:30 left", "batches: 920/1000, 1:20 left"]


SCRIPT = """
from mimicbench.benchmark import Recipe, run_stage
from mimicbench.core.run import RunContext
from mimicbench.objects.make import ObjectsConfig
from mimicbench.references.make import ReferencesConfig
{guard}
recipe = Recipe(objects=ObjectsConfig(count=2), references=ReferencesConfig(count=2))
run_stage("references", recipe, "work", RunContext(workers={workers}, quiet=True))
"""


@pytest.mark.parametrize(
    ("guard", "workers", "told"),
    [
        ("", 1, None),
        ("", 2, "script.py does its work when it is imported"),
        ("print(__name__)", 2, "does its work when"),
    ],
)
def test_a_script_without_a_guard_gets_a_sentence_that_names_it(guard, workers, told, tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT.format(guard=guard, workers=workers))
    done = subprocess.run(
        [sys.executable, "script.py"], capture_output=True, text=True, cwd=tmp_path, env={**os.environ}, check=False
    )
    if told is None:
        assert done.returncode == 0, done.stderr
        return
    assert done.returncode != 0 and told in done.stderr and "bootstrapping" not in done.stderr
    assert done.stderr.count("Traceback") <= 1 or guard, "that of the script itself"


def test_only_who_looks_needs_eyes(tmp_path):
    for learner, looks in (
        ("planner", True),
        ("act-clock", True),
        ("act", False),
        ("hit", False),
        ("diffusion", False),
        ("ppo", False),
    ):
        config = stage_type("imitate", {"learner": learner})()
        assert config.remembers == looks, learner
        run = start(making.small(imitate=config), tmp_path, making.QUIET)
        key = keys.imitate_key(run, SHIPPED / "sit-chair" / "tracker" if config.references else None)
        assert ("perception" in key.made_from) == ("perception" in key.settings) == looks
        assert ("tracker" in key.made_from) == ("retarget" in key.made_from or config.clones) == config.references
