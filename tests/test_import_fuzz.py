"""Thousands of damaged files of all formats: each is read or refused with one sentence, quickly, in little memory,
and nothing in it is run.

By default a sample; MIMICBENCH_FUZZ=2400 does that many.
"""

import os
import pickle
import resource
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

import recordings
from mimicbench.core.errors import BadFile, BadMotion
from mimicbench.references.importers.registry import FORMATS, import_recording
from mimicbench.references.recordings.real_clips import TASKS, find_clips

COUNT = int(os.environ.get("MIMICBENCH_FUZZ", "420")) // len(FORMATS)
SLOWEST, MEMORY = 2.0, 400 << 20
DANGEROUS = (
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "subprocess.Popen",
    "os.remove",
    "os.rename",
    "os.mkdir",
    "socket.connect",
    "pickle.find_class",
    "shutil.rmtree",
)
watching, seen = [False], []


def watch(event, arguments):
    if watching[0] and event in DANGEROUS:
        seen.append((event, arguments))


sys.addaudithook(watch)


class Call:
    def __init__(self, function, *args):
        self.call = (function, args)

    def __reduce__(self):
        return self.call


def mutated_bytes(raw: bytes, random: np.random.Generator) -> bytes:
    """Cut off, flipped, overwritten, doubled; near both ends, where the structure is, as often as anywhere."""

    def place() -> int:
        edge = min(len(raw), 700)
        return int(
            random.choice([random.integers(len(raw)), random.integers(edge), len(raw) - 1 - random.integers(edge)])
        )

    changed = bytearray(raw)
    kind = int(random.integers(6))
    if kind == 0:
        return raw[: place()]
    if kind == 1:
        for _ in range(int(random.integers(1, 9))):
            changed[place()] ^= 1 << int(random.integers(8))
    elif kind == 2:
        for _ in range(int(random.integers(1, 5))):
            changed[place()] = int(random.integers(256))
    elif kind == 3:
        at, length = place(), int(random.integers(1, 64))
        changed[at : at + length] = bytes(random.choice([0, 255], 1).astype(np.uint8)) * length
    elif kind == 4:
        at = place()
        changed[at:at] = changed[place() :][: int(random.integers(1, 200))]
    else:
        at = place()
        del changed[at : at + int(random.integers(1, 200))]
    return bytes(changed)


def mutated_text(raw: bytes, random: np.random.Generator) -> bytes:
    """Some words of a text are others: no numbers, huge numbers, other keywords."""
    words = raw.split(b" ")
    odd = [
        b"nan",
        b"inf",
        b"-1e300",
        b"999999999",
        b"",
        b"x",
        b"{",
        b"}",
        b"End",
        b"JOINT a",
        b"-1",
        b"0",
        b"1e-300",
        b"CHANNELS 6",
        b"\xff\xfe",
        b"MOTION\n",
        b"OFFSET",
    ]
    for _ in range(int(random.integers(1, 4))):
        at = int(random.integers(len(words))) if random.uniform() < 0.5 else int(random.integers(min(len(words), 300)))
        words[at] = odd[int(random.integers(len(odd)))] + (b"\n" if b"\n" in words[at] else b"")
    return b" ".join(words)


def mutated_array(array: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """NaN, infinity, one frame, other units, other order, other shape, other type, zeros."""
    array, kind = np.array(array, copy=True), int(random.integers(11))
    if kind == 0 and array.dtype.kind == "f" and array.size:
        array.reshape(-1)[int(random.integers(array.size))] = random.choice([np.nan, np.inf, -np.inf, 1e30])
    elif kind == 1 and array.ndim:
        array = array[: int(random.integers(3))]
    elif kind == 2 and array.dtype.kind == "f":
        array = array * random.choice([0.0, 1e-3, 0.01, 39.37, 100.0, 1000.0, -1.0])
    elif kind == 3 and array.ndim:
        array = np.roll(array, int(random.integers(1, 5)), -1)
    elif kind == 4 and array.ndim > 1:
        array = np.delete(array, 0, int(random.integers(1, array.ndim)))
    elif kind == 5:
        array = (
            array.astype(random.choice(["f2", "i4", "c8", "U5", "?", "f8"])) if array.dtype.kind == "f" else np.zeros(0)
        )
    elif kind == 6:
        array = array.reshape(-1)
    elif kind == 7 and array.ndim:
        array = random.permuted(array, axis=int(random.integers(array.ndim)))
    elif kind == 8 and array.dtype.kind == "f":
        array = array + random.standard_normal(array.shape) * random.choice([1e-4, 0.03, 1.0])
    elif kind == 9 and array.ndim and len(array):
        array = np.repeat(array[:1], len(array), 0)
    elif array.ndim > 1:
        array = np.broadcast_to(array[:1, ...], (int(random.integers(1, 200)), *array.shape[1:])).copy()
    return array


def mutated_content(form: str, path: Path, random: np.random.Generator) -> None:
    """The file written anew with a part of its content changed, or with a call of a function in it."""
    evil = Call(os.system, "touch fuzz_was_here") if random.uniform() < 0.15 else None
    if form == "unihsi":
        data = np.load(path, allow_pickle=True).item()
        key = str(random.choice(list(data)))
        if evil is not None:
            data[key] = evil
        elif isinstance(data[key], dict) and "arr" in data[key]:
            data[key]["arr"] = mutated_array(data[key]["arr"], random)
        elif isinstance(data[key], dict):
            inner = str(random.choice(["parent_indices", "local_translation"]))
            data[key][inner]["arr"] = mutated_array(data[key][inner]["arr"], random)
        else:
            data[key] = [None, 0, -1, float("nan"), "text", 1e9, [], {}, True][int(random.integers(9))]
        np.save(path, np.array(data, dtype=object), allow_pickle=True)
    elif form == "core4d":
        person = np.load(path, allow_pickle=True)["arr_0"].item()
        key = str(random.choice(["global_orient", "body_pose", "joints"]))
        person[key] = evil if evil is not None else mutated_array(person[key], random)
        np.savez(path, np.array(person, dtype=object))
        track = path.with_name("smooth_objposes.npy")
        if random.uniform() < 0.3:
            np.save(track, mutated_array(np.load(track), random))
    elif form in ("amass", "unihsi-states"):
        data = dict(np.load(path))
        key = str(random.choice(list(data)))
        data[key] = np.array([evil], dtype=object) if evil is not None else mutated_array(data[key], random)
        np.savez(path, **data)
    elif form == "roam":
        array = mutated_array(np.loadtxt(path).reshape(-1, 27, 12), random)
        np.savetxt(path, array.reshape(len(array), -1) if array.size else array.reshape(-1), fmt="%s")
    elif evil is not None:
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in members.items():
                archive.writestr(name, pickle.dumps(evil, 2) if name.endswith("data.pkl") else content)
    else:
        array = mutated_array(torch.load(path, weights_only=True).numpy(), random)
        torch.save(torch.tensor(array) if array.dtype.kind in "fi" else [str(array)], path)


@pytest.mark.parametrize("form", FORMATS)
def test_damaged_files_are_read_or_refused(tmp_path, form, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "files"
    folder.mkdir()
    path = recordings.WRITERS[form](folder)
    good = {file: file.read_bytes() for file in folder.iterdir()}
    random = np.random.default_rng(list(FORMATS).index(form))
    outcomes = {"read": 0, "refused": 0}
    tasks = list(TASKS)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for i in range(COUNT):
        for file, raw in good.items():
            file.write_bytes(raw)
        if form == "bvh":
            path.write_bytes((mutated_bytes if i % 2 else mutated_text)(good[path], random))
        elif i % 2:
            path.write_bytes(mutated_bytes(good[path], random))
        else:
            mutated_content(form, path, random)
        start, watching[0] = time.perf_counter(), True
        try:
            recording = import_recording(path, form if i % 3 else "auto")
            outcomes["read"] += 1
            pos, quat = recording.forward_kinematics()
            assert (
                np.isfinite(pos).all()
                and np.abs(np.linalg.norm(quat, axis=-1) - 1).max() < 1e-6
                and 1 <= recording.fps <= 1000
            )
            if np.abs(pos).max() < 100:
                find_clips(recording, tasks[i % len(tasks)])
        except (BadFile, BadMotion) as error:
            outcomes["refused"] += 1
            assert "\n" not in str(error) and 20 < len(str(error)) < 900
        finally:
            watching[0] = False
        assert time.perf_counter() - start < SLOWEST, f"mutation {i} takes long"
        assert not seen, f"mutation {i} ran {seen}"
    assert not (tmp_path / "fuzz_was_here").exists()
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown * 1024 < MEMORY, f"{grown >> 10} MiB"
    assert outcomes["refused"] > 0.3 * COUNT and (outcomes["read"] > 0 or COUNT < 300), outcomes
