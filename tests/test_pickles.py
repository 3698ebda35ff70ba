"""Foreign pickles: what is plain data is read exactly, and nothing else does anything."""

import io
import os
import pickle
import struct
from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mimicbench.core.errors import BadFile
from mimicbench.core.foreign.untrusted import load_restricted

LIMIT = 1 << 20


class Call:
    """Pickles as a call of any function."""

    def __init__(self, function, *args):
        self.parts = (function, args)

    def __reduce__(self):
        return self.parts


def npy(value) -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array(value, dtype=object), allow_pickle=True)
    return stream.getvalue()


def load(tmp_path: Path, raw: bytes):
    path = tmp_path / "clip.npy"
    path.write_bytes(raw)
    return load_restricted(path, LIMIT)


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_plain_data_is_read_exactly(tmp_path, protocol):
    value = OrderedDict(
        a={"arr": np.arange(12, dtype=np.float32).reshape(3, 4), "context": {"dtype": "float32"}},
        b=[1, 2.5, None, True, "text", b"bytes"],
        f=np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        s=np.float64(3.25),
        e=np.zeros((0, 3)),
        words=np.array(["one", "three"]),
        names=np.array(["x", None, 3], dtype=object),
        big=np.arange(3, dtype=">i4"),
    )
    if protocol == 5:
        # arrays of protocol 5 need an instruction and a function that are not on the lists
        with pytest.raises(BadFile, match="BYTEARRAY8|_frombuffer"):
            load(tmp_path, pickle.dumps(value, protocol))
        return
    if protocol == 2:
        del value["b"]  # bytes of protocol 2 are made by calling codecs
        value = {key: item for key, item in value.items() if not isinstance(item, np.ndarray | np.generic | dict)}
    found = load(tmp_path, pickle.dumps(value, protocol))
    assert list(found) == list(value)
    for key, item in value.items():
        if isinstance(item, np.ndarray):
            np.testing.assert_array_equal(found[key], item)
            assert found[key].dtype == item.dtype
    if "a" in value:
        np.testing.assert_array_equal(found["a"]["arr"], value["a"]["arr"])
        assert found["b"] == value["b"] and found["s"] == 3.25


def test_plain_npy_and_object_npy(tmp_path):
    array = np.arange(24.0).reshape(2, 3, 4)
    np.save(tmp_path / "plain.npy", array)
    np.testing.assert_array_equal(load_restricted(tmp_path / "plain.npy", LIMIT), array)
    assert load(tmp_path, npy({"x": 1})) == {"x": 1}


@pytest.mark.parametrize(
    ("function", "args"),
    [
        (os.system, ("touch {}",)),
        (eval, ("open('{}', 'w')",)),
        (exec, ("open('{}', 'w')",)),
        (open, ("{}", "w")),
        (os.mkdir, ("{}",)),
        (np.load, ("{}",)),
    ],
)
@pytest.mark.parametrize("wrap", [npy, pickle.dumps])
def test_a_call_is_refused_and_not_made(tmp_path, function, args, wrap):
    trace = tmp_path / "trace"
    raw = wrap({"rotation": Call(function, *(arg.format(trace) for arg in args))})
    with pytest.raises(BadFile, match="nothing was run") as caught:
        load(tmp_path, raw)
    assert function.__name__ in str(caught.value), "the message names what was refused"
    assert not trace.exists()


def test_stack_global_and_extension_are_refused(tmp_path):
    raw = b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x04true\x85R."
    with pytest.raises(BadFile, match=r"posix\.system"):
        load(tmp_path, raw)
    for raw in (b"\x80\x02\x82\x01.", b"\x80\x02Pid\n.", b"(iposix\nsystem\n.", b"\x80\x02(cnumpy\nndarray\no."):
        with pytest.raises(BadFile, match="nothing was run"):
            load(tmp_path, raw)


BOMBS = {
    "memo table of 16 GB": b"\x80\x02Nr\xff\xff\xff\x7f.",
    "bytes of 2^60": b"\x80\x04\x8e" + struct.pack("<Q", 1 << 60) + b"x.",
    "text of 4 GB": b"\x80\x02X\xff\xff\xff\x7fx.",
    "ndarray called": b"\x80\x02cnumpy\nndarray\nJ\xff\xff\xff\x7f\x85R.",
    "list in itself": b"\x80\x02]q\x00h\x00a.",
    "attributes of a function": b"\x80\x02cnumpy.core.multiarray\n_reconstruct\n}X\x05\x00\x00\x00_makeNsb.",
    "too many instructions": b"\x80\x02" + b"0".join([b"N"] * 40_000) + b".",
    "laughs": b"\x80\x02]q\x00Na"
    + b"".join(b"]q" + bytes([i + 1]) + b"(" + b"h" + bytes([i]) + (b"h" + bytes([i])) * 9 + b"e" for i in range(100))
    + b".",
    "deep": b"\x80\x02N" + b"\x85" * 15_000 + b".",
    "deep key": b"\x80\x02}N" + b"\x85" * 15_000 + b"Ns.",
    "tuples of tuples as a key": b"\x80\x04})\x94"
    + b"".join(b"0h" + bytes([i]) + b"h" + bytes([i]) + b"\x86\x94" for i in range(60))
    + b"Ns.",
    "tuples of tuples as a shape": b"\x80\x03cnumpy.core.multiarray\n_reconstruct\n"
    + b"cnumpy\nndarray\nK\x00\x85C\x01b\x87R(K\x01)q\x00"
    + b"".join(b"0h" + bytes([i]) + b"h" + bytes([i]) + b"\x86q" + bytes([i + 1]) for i in range(60))
    + b"cnumpy\ndtype\nX\x02\x00\x00\x00f8\x85R\x89C\x00tb.",
    "no value": b".",
    "python 2": b"(dp0\n.",
}


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_end_in_one_error_or_in_little(tmp_path, name):
    try:
        load(tmp_path, BOMBS[name])
    except BadFile as error:
        assert "\n" not in str(error)
    else:
        assert name == "laughs", "shared lists are shared again, which costs nothing"


def test_an_array_must_fill_its_shape(tmp_path):
    raw = pickle.dumps(np.arange(4.0), 3)
    assert raw.count(b"K\x04\x85") == 1
    for count in (0, 3, 5, 255):
        with pytest.raises(BadFile):
            load(tmp_path, raw.replace(b"K\x04\x85", b"K" + bytes([count]) + b"\x85"))
    with pytest.raises(BadFile):
        load(tmp_path, pickle.dumps(np.zeros(3, dtype=[("x", "f4")]), 3))
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40, 1 << 20)})
    with pytest.raises(BadFile):
        load(tmp_path, header.getvalue() + bytes(64))


def test_missing_empty_large_and_folders(tmp_path):
    with pytest.raises(BadFile, match="does not exist|cannot be read"):
        load_restricted(tmp_path / "none.npy", LIMIT)
    with pytest.raises(BadFile, match="empty"):
        load(tmp_path, b"")
    with pytest.raises(BadFile, match="more than"):
        load(tmp_path, bytes(LIMIT + 1))
    with pytest.raises(BadFile):
        load_restricted(tmp_path, LIMIT)


@settings(max_examples=120, deadline=None)
@example(raw=b"(\x94", head=b"")
@given(
    raw=st.binary(max_size=60),
    head=st.sampled_from([b"", b"\x80\x03", b"\x80\x04\x95", b"\x93NUMPY\x01\x00", b"\x93NUMPY\x01\x00\x10\x00"]),
)
def test_any_bytes_end_in_a_value_or_one_error(tmp_path_factory, raw, head):
    try:
        load(tmp_path_factory.getbasetemp(), head + raw)
    except BadFile as error:
        assert "\n" not in str(error)
