"""Checkpoints that lie about their sizes are refused before anything is made of them."""

import json
import shutil
import tracemalloc
from pathlib import Path

import pytest

import mimicbench
from mimicbench.core.checkpoint import BadCheckpoint, checkpoint_kind
from mimicbench.imitate.learned import load_learner
from mimicbench.imitate.learners.act import ACTConfig
from mimicbench.imitate.learners.bc import BCConfig
from mimicbench.imitate.perception import load_perception
from mimicbench.policies.loading import load_policy
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import load_tracker
from stool import H1

SHIPPED = Path(mimicbench.__path__[0]) / "checkpoints" / "sit-chair"
KINDS = ("planner", "perception", "act", "bc", "tracker")
HUGE = 200_000
LIES = [
    ("planner", "hidden", [512, HUGE, 256], "hidden|layers"),
    ("planner", "hidden", [8] * 1000, "1000 layers"),
    ("planner", "hidden", [512, -1, 256], "is -1"),
    ("planner", "hidden", [512.5], "does not describe"),
    ("perception", "hidden", HUGE, "needs"),
    ("perception", "widths", [HUGE, HUGE], "needs"),
    ("perception", "window", 10**7, "needs"),
    ("perception", "widths", [], "describes no|needs|holds"),
    ("act", "hidden", HUGE, "needs"),
    ("act", "hidden", "wide", "does not describe"),
    ("act", "hidden", "96", "does not describe"),
    ("act", "heads", -4, "is -4"),
    ("act", "decoder_layers", 10**9, "1000000000 layers"),
    ("act", "posterior_layers", -1, "is -1"),
    ("act", "chunk", 10**9, "needs"),
    ("act", "encoder", {"cells": 2**20, "pool": 1}, "numbers beside|needs|lacks"),
    ("act", "encoder", {"pool": 0}, "describes no"),
    ("act", "encoder", {"widths": [16, HUGE, 48]}, "needs|lacks"),
    ("act", "encoder", {"widths": [16, HUGE, 48, 64]}, "does not describe.*one stride less"),
    ("act", "encoder", {"blocks": [10**8, 1, 1, 1]}, "layers"),
    ("bc", "hidden", HUGE, "needs"),
    ("bc", "reduce", [HUGE], "needs"),
    ("bc", "action_size", 0, "needs|describes no"),
    ("bc", "inputs", {"body": "soul"}, "does not describe"),
    ("tracker", "hidden", [HUGE], "8192"),
    ("tracker", "hidden", [8000, 8000], "needs"),
    *((kind, "favourite", 7, "unknown 'favourite'") for kind in KINDS),
]


def load(folder, kind):
    if kind in ("act", "bc"):
        return load_learner(folder, H1, {"act": ACTConfig, "bc": BCConfig}[checkpoint_kind(folder)])
    if kind == "perception":
        return load_perception(folder, "h1")
    if kind == "tracker":
        return load_tracker(folder, H1)
    return load_policy(folder, H1, TASKS.get("sit-chair"))


@pytest.fixture(scope="module")
def shipped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shipped")
    for kind in KINDS:
        shutil.copytree(SHIPPED / kind, folder / kind)
    return folder


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_shipped_is_read(kind, shipped):
    load(shipped / kind, kind)


@pytest.mark.parametrize(("kind", "name", "lie", "told"), LIES)
def test_lies_about_sizes_are_told_apart(kind, name, lie, told, shipped):
    path = shipped / kind / "config.json"
    honest = path.read_text()
    header = json.loads(honest)
    header.pop("digest", None)
    before = header["config"].get(name)
    header["config"][name] = {**before, **lie} if isinstance(lie, dict) else lie
    path.write_text(json.dumps(header))
    tracemalloc.start()
    try:
        with pytest.raises(BadCheckpoint, match=told) as caught:
            load(shipped / kind, kind)
        assert "\n" not in str(caught.value)
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()
        path.write_text(honest)


def test_nothing_is_allocated_for_a_lie(shipped):
    """Of torch's memory, too: a hidden width that would take 3 TB is refused in no time."""
    path = shipped / "act" / "config.json"
    honest = path.read_text()
    header = json.loads(honest)
    header.pop("digest", None)
    header["config"]["feedforward"] = 1 << 33
    path.write_text(json.dumps(header))
    try:
        with pytest.raises(BadCheckpoint, match="needs"):
            load(shipped / "act", "act")
    finally:
        path.write_text(honest)
