"""Flipped bits, lost stretches, cut ends: what we write is refused, or reads as it was. More: `corrupt_files.py`."""

import sys
from pathlib import Path

import numpy as np
import pytest

from mimicbench.core.errors import BadFile, BadObject
from mimicbench.core.files import read_json, read_record, write_json, write_record
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.shape import SceneObject, load_object, save_object

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
from corrupt_files import KINDS, campaign


@pytest.mark.parametrize("name", KINDS)
def test_nothing_damaged_is_read_silently(name, tmp_path):
    found, wrong = campaign(KINDS[name], 40, 1, tmp_path)
    assert not wrong and found["refused"] >= 25


def test_a_record_is_as_it_was_written(tmp_path):
    path = tmp_path / "a.json"
    write_record(path, {"b": [1, 2.5, None], "a": "x"})
    assert read_record(path, ("a", "b")) == {"b": [1, 2.5, None], "a": "x"}
    written = read_json(path)
    write_json(path, {**written, "a": "y"})
    with pytest.raises(BadFile, match="if you have edited it, remove its 'digest'"):
        read_record(path)
    write_json(path, {"a": "y", "b": []})
    assert read_record(path, ("a", "b")) == {"a": "y", "b": []}, "written by hand"
    write_json(path, {"a": "y", "digesu": written["digest"]})
    with pytest.raises(BadFile, match="unknown 'digesu'"):
        read_record(path, ("a", "b"))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("box_quat", [[2.0, 0, 0, 0]]),
        ("box_half", [[0.1, 0.1, 1e6]]),
        ("box_pos", [[0.0, 0.0, float("nan")]]),
        ("touch_points", [[0.0, 0, 0]]),
        ("seat_polygon", [[0.0, 0], [1, 0]]),
        ("seat_polygon", [[0.0, 0], [1, 0], [float("inf"), 1]]),
        ("seat_height", -0.4),
        ("mass", -2.0),
        ("mass", None),
        ("mass", float("nan")),
        ("friction", 0.0),
        ("mass", "heavy"),
    ],
)
def test_an_object_is_one_that_can_be(name, value):
    whole = make_box(0).to_dict()
    if name.startswith("box_"):
        value = value * len(whole[name])
    assert SceneObject.from_dict(whole).movable
    with pytest.raises(BadObject):
        SceneObject.from_dict({**whole, name: value})


def test_an_object_is_the_one_that_was_asked_for(tmp_path):
    save_object(tmp_path, make_chair(1))
    (tmp_path / f"{make_chair(1).id}.json").rename(tmp_path / f"{make_chair(2).id}.json")
    with pytest.raises(BadObject, match=f"holds the object {make_chair(1).id}"):
        load_object(tmp_path, make_chair(2).id)
    assert np.allclose(np.linalg.norm(make_chair(1).box_quat, axis=1), 1)
