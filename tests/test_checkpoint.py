"""Checkpoints: round trip, and one clear sentence for everything that can be wrong with one."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import mimicbench
from mimicbench.core.checkpoint import (
    BadCheckpoint,
    checkpoint_digest,
    copy_checkpoint,
    load_checkpoint,
    save_checkpoint,
)
from mimicbench.core.files import digest_of


@dataclass(frozen=True)
class Config:
    hidden: tuple[int, ...] = (4, 3)
    rate: float = 0.5


TENSORS = {"weight": np.arange(12, dtype=np.float32).reshape(4, 3), "count": np.array(7)}


@pytest.fixture
def folder(tmp_path):
    save_checkpoint(tmp_path / "net", "tracker", "h1", Config(hidden=(8, 2)), TENSORS, {"steps": 5})
    return tmp_path / "net"


def test_round_trip(folder):
    found = load_checkpoint(folder, "tracker", "h1")
    assert found.config_as(Config) == Config(hidden=(8, 2))
    assert found.notes["steps"] == 5
    arrays = found.matching({"weight": (4, 3), "count": ()})
    assert all((arrays[name] == TENSORS[name]).all() and arrays[name].dtype == TENSORS[name].dtype for name in TENSORS)


def test_same_content_same_bytes(folder, tmp_path):
    save_checkpoint(tmp_path / "other", "tracker", "h1", Config(hidden=(8, 2)), TENSORS, {"steps": 5})
    for name in ("config.json", "model.safetensors"):
        assert (folder / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


def test_another_robot_or_kind(folder):
    with pytest.raises(BadCheckpoint, match="a checkpoint of another robot, 'h1'"):
        load_checkpoint(folder, "tracker", "g1")
    with pytest.raises(BadCheckpoint, match="of kind 'tracker', not 'act'"):
        load_checkpoint(folder, "act", "h1")


@pytest.mark.parametrize("keep", [0, 4, 100, -3])
def test_cut_off_model(folder, keep):
    path = folder / "model.safetensors"
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(BadCheckpoint, match="cut off"):
        load_checkpoint(folder)


def test_missing_parts(folder, tmp_path):
    with pytest.raises(BadCheckpoint, match="no config.json"):
        load_checkpoint(tmp_path / "nowhere")
    (folder / "model.safetensors").unlink()
    with pytest.raises(BadCheckpoint, match="does not exist"):
        load_checkpoint(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 99}, "format 99"),
        ({"robot": 3}, "does not describe"),
        ({"config": {"hidden": "x"}}, "does not describe"),
    ],
)
def test_changed_header(folder, change, message):
    path = folder / "config.json"
    header = json.loads(path.read_text())
    del header["digest"]
    path.write_text(json.dumps(header | change))
    with pytest.raises(BadCheckpoint, match=message):
        load_checkpoint(folder).config_as(Config)


def test_wrong_shapes(folder):
    found = load_checkpoint(folder)
    with pytest.raises(BadCheckpoint, match="4 x 3, but the tracker of its config.json needs 4 x 4"):
        found.matching({"weight": (4, 4), "count": ()})
    with pytest.raises(BadCheckpoint, match="lacks 'bias'"):
        found.matching({"weight": (4, 3), "count": (), "bias": (3,)})
    with pytest.raises(BadCheckpoint, match="holds 'count'"):
        found.matching({"weight": (4, 3)})


def test_not_finite_is_not_written(folder):
    before = (folder / "model.safetensors").read_bytes()
    with pytest.raises(BadCheckpoint, match="diverged"):
        save_checkpoint(folder, "tracker", "h1", Config(), {"weight": np.array([np.nan])})
    assert (folder / "model.safetensors").read_bytes() == before


def test_numbers_of_another_folder(folder, tmp_path):
    same = tmp_path / "task" / "net"
    same.mkdir(parents=True)
    (same / "config.json").write_bytes((folder / "config.json").read_bytes())
    (same / "model.same-as").write_text("../../net\n")
    found = load_checkpoint(same, "tracker", "h1")
    assert found.matching({"weight": (4, 3), "count": ()})["weight"].tolist() == TENSORS["weight"].tolist()
    assert checkpoint_digest(same) == checkpoint_digest(folder)
    copy_checkpoint(same, tmp_path / "copy")  # which is whole by itself
    assert sorted(path.name for path in (tmp_path / "copy").iterdir()) == ["config.json", "model.safetensors"]
    save_checkpoint(same, "tracker", "h1", Config(hidden=(8, 2)), {"weight": -TENSORS["weight"]})
    assert (load_checkpoint(same).tensors["weight"] <= 0).all()  # its own come first
    assert (load_checkpoint(folder).tensors["weight"] >= 0).all()


@pytest.mark.parametrize("way", ["", "../nowhere\n", "\0\n", "x" * 5000, "\xff"])
def test_numbers_of_a_folder_that_is_not_there(folder, way):
    (folder / "model.safetensors").unlink()
    (folder / "model.same-as").write_bytes(way.encode("latin-1"))
    with pytest.raises(BadCheckpoint, match="does not exist"):
        load_checkpoint(folder)


def test_what_is_shipped_is_stored_once():
    files = [path for path in Path(mimicbench.__file__).parent.glob("checkpoints/**/*.safetensors")]
    large = [path for path in files if path.stat().st_size > 1000]
    by_bytes = {digest_of(path): path for path in large}
    assert large and len(by_bytes) == len(large), set(large) - set(by_bytes.values())


def test_the_mean_of_checkpoints(folder, tmp_path, monkeypatch):
    """Of weights w, w + 3 and w - 9: w - 2, to the digit; where the last one is replaced, too. Others are refused."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "scripts"))
    from average import average

    weight, others = TENSORS["weight"], [tmp_path / "second", tmp_path / "third"]
    for other, more in zip(others, (3, -9), strict=True):
        save_checkpoint(
            other, "tracker", "h1", Config(), {**TENSORS, "weight": weight + np.float32(more)}, {"steps": 6}
        )
    average([folder, *others], others[1])
    mean = load_checkpoint(others[1])
    assert mean.notes["steps"] == 6 and mean.notes["mean_of"] == 3 and mean.config_as(Config) == Config()
    np.testing.assert_array_equal(mean.tensors["weight"], weight - 2)
    save_checkpoint(others[0], "tracker", "h1", Config(), {"weight": weight})
    with pytest.raises(SystemExit, match=r"is not of the kind and shape of .*give checkpoints of one training"):
        average([others[0], folder], tmp_path / "out")
