"""Files: whole or absent, the same bytes for the same content, bounded, and never half believed."""

import contextlib
import io
import json
import struct
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from mimicbench.core.errors import BadFile
from mimicbench.core.files import MAX_UNPACKED, read_json, read_npz, write_atomic, write_json, write_npz

ARRAYS = {
    "a": np.arange(12, dtype=np.float32).reshape(3, 4),
    "flags": np.array([True, False]),
    "empty": np.zeros((0, 2)),
}


@pytest.fixture
def path(tmp_path):
    write_npz(tmp_path / "thing.npz", {"type": "thing", "name": "é"}, ARRAYS)
    return tmp_path / "thing.npz"


def test_round_trip(path):
    header, arrays = read_npz(path, "thing")
    assert header == {"type": "thing", "name": "é"}
    assert arrays.keys() == ARRAYS.keys()
    for name, array in arrays.items():
        assert array.dtype == ARRAYS[name].dtype
        np.testing.assert_array_equal(array, ARRAYS[name])


def test_same_content_same_bytes(path, tmp_path):
    write_npz(tmp_path / "again.npz", {"name": "é", "type": "thing"}, ARRAYS)
    assert path.read_bytes() == (tmp_path / "again.npz").read_bytes()


def test_a_folder_is_not_written_over_by_a_file(tmp_path):
    with pytest.raises(BadFile, match="is a folder; give the name of a file"):
        write_json(tmp_path, {})
    assert not list(tmp_path.iterdir()) and not list(tmp_path.parent.glob(".*.tmp"))


def test_cut_off_anywhere(path):
    whole = path.read_bytes()
    for length in (*range(0, len(whole) - 1, 23), len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(BadFile, match=r"thing\.npz"):
            read_npz(path, "thing")


def test_a_flipped_byte_is_never_an_unexpected_error(path):
    whole = bytearray(path.read_bytes())
    for place in range(0, len(whole), 7):
        damaged = bytearray(whole)
        damaged[place] ^= 0x55
        path.write_bytes(damaged)
        with contextlib.suppress(BadFile):
            read_npz(path, "thing")


def test_another_kind_is_refused(path):
    with pytest.raises(BadFile, match="holds 'thing', expected 'motion'"):
        read_npz(path, "motion")


def npz(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)


def npy(array):
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


HEADER = npy(np.array(json.dumps({"type": "thing"})))


@pytest.mark.parametrize(
    "members",
    [
        {},
        {"a.npy": npy(np.ones(3))},
        {"header.npy": npy(np.array("no json"))},
        {"header.npy": npy(np.array("[" * 5000))},
        {"header.npy": npy(np.array("[1]"))},
        {"header.npy": npy(np.ones(3))},
        {"header.npy": HEADER, "a.npy": b"\x93NUMPY\x01\x00"},
    ],
)
def test_other_archives_are_refused(tmp_path, members):
    npz(tmp_path / "x.npz", members)
    with pytest.raises(BadFile):
        read_npz(tmp_path / "x.npz", "thing")


def test_pickled_arrays_are_not_opened(tmp_path):
    np.savez(tmp_path / "x.npz", header=np.array(json.dumps({"type": "thing"})), a=np.array([print], dtype=object))
    with pytest.raises(BadFile):
        read_npz(tmp_path / "x.npz", "thing")


def test_bomb_is_refused_before_it_is_unpacked(tmp_path):
    # a member that says in the archive's directory that it unpacks to gigabytes
    path = tmp_path / "bomb.npz"
    npz(path, {"header.npy": HEADER, "a.npy": npy(np.zeros(1000))})
    data = bytearray(path.read_bytes())
    entry = data.rindex(b"PK\x01\x02")
    data[entry + 24 : entry + 28] = struct.pack("<I", 0xF0000000)
    path.write_bytes(data)
    assert MAX_UNPACKED < 0xF0000000
    with pytest.raises(BadFile, match="refusing to read"):
        read_npz(path, "thing")


def test_array_that_claims_to_be_huge(tmp_path):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (1 << 50,)})
    npz(tmp_path / "x.npz", {"header.npy": HEADER, "a.npy": stream.getvalue() + bytes(32)})
    with pytest.raises(BadFile):
        read_npz(tmp_path / "x.npz", "thing")


def test_nothing_is_left_of_a_failed_write(tmp_path):
    path = tmp_path / "deep" / "file"
    write_atomic(path, lambda stream: stream.write(b"old"))

    def fail(stream):
        stream.write(b"half")
        raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        write_atomic(path, fail)
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in path.parent.iterdir()] == ["file"]


def test_a_writer_killed_in_the_middle_leaves_the_old_file(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    script = f"""
import os, signal
from pathlib import Path
from mimicbench.core.files import write_atomic
def write(stream):
    stream.write(b"half")
    stream.flush()
    os.kill(os.getpid(), signal.SIGKILL)
write_atomic(Path({str(path)!r}), write)
"""
    assert subprocess.run([sys.executable, "-c", script]).returncode == -9
    assert path.read_bytes() == b"old"


def test_json(tmp_path):
    write_json(tmp_path / "a.json", {"b": 1, "a": [1.5, None]})
    assert read_json(tmp_path / "a.json") == {"b": 1, "a": [1.5, None]}
    (tmp_path / "cut.json").write_bytes((tmp_path / "a.json").read_bytes()[:9])
    for name, message in (("none.json", "does not exist"), ("cut.json", "cut off")):
        with pytest.raises(BadFile, match=message):
            read_json(tmp_path / name)
    with pytest.raises(BadFile, match="larger than"):
        read_json(tmp_path / "a.json", max_bytes=4)
