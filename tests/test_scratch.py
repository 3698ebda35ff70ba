"""Demonstrations that are too large for memory: the same, in files that nobody sees; a full disk is told."""

import errno
import os

import numpy as np
import pytest

from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.lerobot import load_demos
from mimicbench.imitate.stored import scratch as stored
from mimicbench.imitate.stored.scratch import joined, scratch
from test_lerobot import fill


@pytest.fixture
def all_is_large(monkeypatch):
    monkeypatch.setattr(stored, "LEAST", 1)


def test_small_arrays_are_in_memory_and_large_ones_in_a_file(tmp_path):
    assert not isinstance(scratch((10, 3), np.float32, tmp_path), np.memmap)
    large = scratch((stored.LEAST // 8, 1), np.float64, tmp_path)
    assert isinstance(large, np.memmap) and large.shape == (stored.LEAST // 8, 1)
    large[-1] = 7.0
    assert large[-1, 0] == 7.0 and not list(tmp_path.iterdir()), "its file has no name"
    assert not isinstance(scratch(large.shape, np.float64, None), np.memmap)


def test_what_is_joined_has_the_rows_of_both(tmp_path, all_is_large, monkeypatch):
    monkeypatch.setattr(stored, "_ROWS", 3)
    first, second = np.arange(14.0).reshape(7, 2), -np.arange(8.0).reshape(4, 2)
    whole = joined([first, second], tmp_path)
    assert isinstance(whole, np.memmap)
    np.testing.assert_array_equal(whole, np.concatenate([first, second]))


def test_demonstrations_are_the_same_on_the_disk(tmp_path, all_is_large):
    folder = fill(tmp_path / "set")
    memory, disk = load_demos(folder), load_demos(folder, disk=tmp_path / "disk")
    for one, other in ((memory, disk), (memory.joined(memory), disk.joined(disk))):
        for name in ("state", "action", "executed_action", "qpos", "qvel", "starts"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert isinstance(other.qpos, np.memmap) and other.reference_ids == one.reference_ids
    assert not list((tmp_path / "disk").iterdir())


def test_a_full_disk_is_told(tmp_path, all_is_large, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(MimicbenchError, match="no room for .* GB of demonstrations"):
        scratch((1000, 1000), np.float64, tmp_path)
