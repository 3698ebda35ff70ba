"""Files and names that are odd or mean harm: each is read or refused with one sentence, soon, and steers nothing."""

import json
import os
import shutil
import struct
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import recordings
import shapes
from mimicbench.core.errors import BadFile, BadMotion, BadObject, MimicbenchError, UnknownName
from mimicbench.core.files import read_npz, write_npz
from mimicbench.core.names import LONGEST, printable, safe_name, typed
from mimicbench.imitate.lerobot import load_demos, load_episode
from mimicbench.imitate.stored.tables import read_table
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.importing.mesh import read_mesh
from mimicbench.objects.importing.own import ImportConfig, import_objects
from mimicbench.objects.shape import SceneObject
from mimicbench.references.importers.recording import Wishes
from mimicbench.references.importers.registry import FORMATS, detect_format, import_recording
from mimicbench.references.recordings.real_clips import find_clips

SAMPLE = Path(__file__).parents[1] / "examples" / "sample" / "sit-chair" / "demos" / "sample" / "dataset"
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a21\nsize 12345\n"


def refused(read, path, seconds=3.0):
    start = time.monotonic()
    with pytest.raises(MimicbenchError) as error:
        read(path)
    assert time.monotonic() - start < seconds
    assert "\n" not in str(error.value) and str(error.value).isprintable()
    return str(error.value)


def command(*arguments, cwd):
    return subprocess.run(
        [sys.executable, "-m", "mimicbench.cli", *arguments],
        capture_output=True,
        cwd=cwd,
        check=False,
        timeout=120,
    )


# -- archives and data sets


@pytest.mark.parametrize(
    "header",
    [
        f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({2**70},), }}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (3, ",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (3,), 1: 2}",
        "{'descr': [('a',)], 'fortran_order': False, 'shape': (3,), }",
    ],
    ids=["huge", "cut off", "a number for a name", "half a type"],
)
def test_arrays_that_lie_about_themselves(header, tmp_path):
    path, raw = tmp_path / "clip.npz", header.encode() + b"\n"
    write_npz(path, {"type": "clip"}, {})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("pos.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(raw)) + raw + bytes(64))
    refused(lambda path: read_npz(path, "clip"), path)


def test_arrays_that_are_packed_in_an_unusual_way(tmp_path):
    path = tmp_path / "clip.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("header.npy", bytes(1000))
    assert "unusual way" in refused(lambda path: read_npz(path, "clip"), path)


def test_objects_of_numbers_beyond_all_measure(tmp_path):
    told = make_chair(0).to_dict()
    told["box_pos"] = [[10**400, 0, 0]] * len(told["box_pos"])
    with pytest.raises(BadObject, match="not an object description"):
        SceneObject.from_dict(told)


def test_names_in_an_archive_lead_nowhere(tmp_path):
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    plain = recordings.states(inner / "plain.npy")
    mean = inner / "mean.npz"
    with zipfile.ZipFile(mean, "w") as archive:
        archive.writestr("states.npy", plain.read_bytes())
        for name in ("../../stolen.npy", "/tmp/mimicbench-stolen.npy", "..\\..\\stolen.npy"):
            archive.writestr(name, plain.read_bytes())
    before = sorted(tmp_path.rglob("*"))
    try:
        assert import_recording(mean).name == "mean"
    except MimicbenchError as error:
        assert str(error).isprintable()
    assert sorted(tmp_path.rglob("*")) == before and not Path("/tmp/mimicbench-stolen.npy").exists()


@pytest.mark.parametrize(("length", "end"), [(10**15, None), (10**15, 10**15), (-5, None), (3, None)])
def test_demonstrations_of_absurd_sizes_are_refused(tmp_path, length, end):
    folder = tmp_path / "dataset"
    shutil.copytree(SAMPLE, folder)
    (path,) = sorted((folder / "meta" / "episodes").rglob("*.parquet"))[:1]
    rows = pq.read_table(path)
    told = rows.to_pylist()
    told[0]["length"] = length
    if end is not None:
        told[-1]["dataset_to_index"] = end
    pq.write_table(pa.Table.from_pylist(told, schema=rows.schema), path)
    assert "frames" in refused(lambda where: load_episode(where, told[0]["episode_index"]), folder)
    refused(load_demos, folder)


def test_a_few_bytes_do_not_become_gigabytes(tmp_path):
    """A billion times the same number is a kilobyte of parquet."""
    path = tmp_path / "bomb.parquet"
    schema = pa.schema([("length", pa.int64())])
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        part = pa.Table.from_arrays([pa.array(np.zeros(20_000_000, np.int64))], schema=schema)
        for _ in range(8):
            writer.write_table(part)
    assert path.stat().st_size < 1e6
    assert "160000000 numbers" in refused(read_table, path)


# -- names


def test_names_are_made_safe():
    assert printable("a\x1b[31mb\nc\udcff") == "a\\x1b[31mb\\nc\\udcff"
    assert printable("one\ntwo\r", lines=True) == "one\ntwo\\r" and printable("Stühle") == "Stühle"
    assert safe_name("chair 1.v2_a-b") == "chair-1.v2_a-b" and safe_name("../../etc") == "etc"
    assert safe_name("\x1b\n") == "unnamed"
    assert typed("work/a") == "work/a" and typed("my work") == "'my work'"
    long = [safe_name(letter * 240) for letter in "ab"] + [safe_name("a" * 239)]
    assert len(set(long)) == 3 and all(len(name) == LONGEST for name in long)


def test_errors_steer_no_terminal():
    assert str(BadFile("x\x1b[2J\ny is bad")) == "x\\x1b[2J\\ny is bad"
    assert "\x1b" not in str(UnknownName("task", "\x1b[2J", ["sit-chair"]))


@pytest.mark.parametrize("stem", ["a" * 240, "\x1b[31mred\nline", os.fsdecode(b"caf\xe9")])
def test_any_name_of_a_recording_makes_an_id(tmp_path, stem):
    recording = import_recording(recordings.skeleton_motion(tmp_path / f"{stem}.npy"))
    assert recording.name.isascii() and recording.name.isprintable() and len(recording.name) <= LONGEST
    (tmp_path / f"{recording.name}.npz").write_bytes(b"x")


def test_a_command_prints_no_escape_codes(tmp_path):
    (tmp_path / "evil\x1b[31m\n.bvh").write_bytes(b"no BVH")
    shapes.chair().export(tmp_path / "evil.stl")
    (tmp_path / "evil.stl").rename(tmp_path / "ev\x1b[31mil\n.stl")
    for words in (("import", "evil\x1b[31m\n.bvh"), ("objects", "import", "ev\x1b[31mil\n.stl")):
        done = command(*words, "--workdir", "w", cwd=tmp_path)
        assert b"\x1b" not in done.stdout + done.stderr and b"Traceback" not in done.stderr
        assert done.stderr.count(b"\n.") == 0
    assert (tmp_path / "w" / "sit-chair" / "objects" / "own" / "own-ev-31mil.json").exists()


# -- time and memory


def test_blank_lines_take_no_time(tmp_path):
    blank = b"\n" * (1 << 20)
    (tmp_path / "blank.bvh").write_bytes(b"HIERARCHY\n" + blank + b"x")
    assert "no HIERARCHY" in refused(import_recording, tmp_path / "blank.bvh")
    (tmp_path / "blank.obj").write_bytes(b"#\n" + blank + b"x")
    assert "no OBJ file" in refused(read_mesh, tmp_path / "blank.obj")
    (tmp_path / "space.obj").write_bytes(b"v 0 0 0\n" + b" \t" * (1 << 19) + blank + b"f")
    assert "cut off" in refused(read_mesh, tmp_path / "space.obj", 8.0)


def glb(text, binary=b""):
    text += b" " * (-len(text) % 4)
    return b"glTF" + struct.pack("<III", 2, 20 + len(text) + len(binary), len(text)) + b"JSON" + text + binary


@pytest.mark.parametrize("what", ["[" * 100_000, '{"accessors": [' + "{}," * 5_000_000 + "{}]}"])
def test_json_of_a_glb_is_parsed_within_the_limits(tmp_path, what):
    import resource

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    (tmp_path / "large.glb").write_bytes(glb(what.encode()))
    message = refused(read_mesh, tmp_path / "large.glb", 60.0)
    assert "JSON" in message
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 300 << 10, "KiB in this process"
    (tmp_path / "huge.glb").write_bytes(glb(b" " * (20 << 20)))
    assert "JSON part of 20 MiB" in refused(read_mesh, tmp_path / "huge.glb", 20.0)


# -- content


def test_pointers_of_git_lfs_are_called_so(tmp_path):
    for name, read in (("a.bvh", import_recording), ("a.npy", import_recording), ("a.npz", import_recording)):
        (tmp_path / name).write_bytes(POINTER)
        assert "Git LFS" in refused(read, tmp_path / name)
    for name in ("a.obj", "a.glb", "a.stl"):
        (tmp_path / name).write_bytes(POINTER)
        assert "Git LFS" in refused(read_mesh, tmp_path / name)


@pytest.mark.parametrize("form", ["amass", "unihsi-states", "core4d", "unihsi", "roam"])
@pytest.mark.parametrize("odd", [np.array(1.0), np.array("x"), np.zeros((0, 3)), np.zeros((2, 3, 4)), np.array(None)])
def test_arrays_of_any_shape_are_refused(tmp_path, form, odd):
    path = recordings.WRITERS[form](tmp_path)
    if form == "roam":
        path = tmp_path / "odd.npy"
        np.save(path, odd)
        refused(lambda file: import_recording(file, form), path)
        return
    stored = np.load(path, allow_pickle=True)
    if form in ("unihsi", "core4d"):
        data = stored.item() if form == "unihsi" else stored["arr_0"].item()
        for key in ("rotation", "root_translation", "global_orient", "body_pose", "joints"):
            if key not in data:
                continue
            changed = data | {key: {"arr": odd} if form == "unihsi" else odd}
            whole = np.array(changed, dtype=object)
            np.save(path, whole, allow_pickle=True) if form == "unihsi" else np.savez(path, whole)
            refused(lambda file: import_recording(file, form), path)
        return
    arrays = dict(stored)
    for key in arrays:
        if key in ("betas", "gender"):
            continue
        np.savez(path, **(arrays | {key: odd}))
        if key != "mocap_framerate" or odd.size != 1 or odd.dtype.kind != "f":
            refused(lambda file: import_recording(file, form), path)
    if form == "amass":
        rest = {key: arrays[key] for key in ("trans", "mocap_framerate")}
        np.savez(path, root_orient=odd, pose_body=odd, **rest)
        refused(lambda file: import_recording(file, form), path)


@pytest.mark.parametrize("form", FORMATS)
def test_options_that_do_not_apply_are_refused(tmp_path, form):
    path = recordings.WRITERS[form](tmp_path)
    heeded = FORMATS.get(form).heeds
    for name, value, option in (("unit", "cm", "--unit"), ("scale", 1.0, "--scale"), ("mesh", path, "--object-mesh")):
        if name not in heeded:
            with pytest.raises(BadFile, match=f"{option} does not apply"):
                import_recording(path, wishes=Wishes(**{name: value}))
    if "mesh" in heeded:
        with pytest.raises(BadMotion, match="--object-mesh is of an object to be touched or lifted"):
            find_clips(import_recording(path, wishes=Wishes(mesh=path)), "sit-chair")


def test_a_mass_is_of_what_is_lifted(tmp_path):
    with pytest.raises(MimicbenchError, match="--mass is of objects to be lifted"):
        import_objects(tmp_path / "o", "sit-chair", "chair", [tmp_path / "x.obj"], ImportConfig(mass=3.0), print)
    assert not (tmp_path / "o").exists()


def test_no_message_recommends_what_does_not_exist():
    from mimicbench import cli

    known = Path(cli.__file__).read_text()
    if "view" not in known:
        for path in Path(cli.__file__).parent.rglob("*.py"):
            assert "mimicbench view" not in path.read_text(), path


def test_formats_are_told_by_content_alone(tmp_path):
    path = recordings.bvh(tmp_path / "take.txt")
    assert detect_format(path) == "bvh" and json.dumps(path.name)
