"""Demonstrations as a LeRobotDataset v3: layout, round trip, resumption, damage."""

import json
from dataclasses import replace

import imageio.v3 as iio
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import digest_of, write_record
from mimicbench.imitate.lerobot import load_demos, recorded_gains
from mimicbench.imitate.stored.demo_writer import Demonstration, DemoWriter
from mimicbench.imitate.stored.tables import read_table, read_tasks, write_table

JOINTS = tuple(f"joint_{i}" for i in range(19))


def demo(number, frames=7, success=True):
    random = np.random.default_rng(number)
    return Demonstration(
        state=random.normal(size=(frames, 300)).astype(np.float32),
        action=random.normal(size=(frames, 19)).astype(np.float32),
        executed_action=random.normal(size=(frames, 19)).astype(np.float32),
        qpos=random.normal(size=(frames, 26)),
        qvel=random.normal(size=(frames, 25)),
        object_id=f"chair-0-{number % 2:05d}",
        reference_id=f"clip-{number:05d}",
        success=success,
        seed=number,
    )


def writer(folder, **changes):
    return DemoWriter(
        folder, **{"robot": "h1", "task": "sit-chair", "joint_names": JOINTS, "shard_episodes": 2} | changes
    )


def fill(folder, count=5):
    out = writer(folder)
    for number in range(count):
        out.add(demo(number, 5 + number, success=number != 3))
    out.finish()
    return folder


def test_layout(tmp_path):
    fill(tmp_path)
    info = json.loads((tmp_path / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["robot_type"] == "h1" and info["fps"] == 50
    assert isinstance(info["fps"], int)
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (5, 5 + 6 + 7 + 8 + 9, 1)
    assert info["splits"] == {"train": "0:5"} and info["video_path"] is None
    assert info["features"]["action"] == {"dtype": "float32", "shape": [19], "names": list(JOINTS)}
    assert info["features"]["observation.state"] == {"dtype": "float32", "shape": [300], "names": None}
    assert info["features"]["timestamp"] == {"dtype": "float32", "shape": [1], "names": None}
    files = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.parquet"))
    shards = [f"chunk-000/file-{i:03d}.parquet" for i in range(3)]
    assert files == [*(f"data/{s}" for s in shards), *(f"meta/episodes/{s}" for s in shards), "meta/tasks.parquet"]
    assert read_tasks(tmp_path) == ["sit-chair"]


def test_entries_of_the_state_have_names(tmp_path):
    names = [f"entry {number}" for number in range(300)]
    named = writer(tmp_path, names={"observation.state": names})
    named.add(demo(0, 5))
    named.finish()
    assert json.loads((tmp_path / "meta/info.json").read_text())["features"]["observation.state"]["names"] == names


def test_frames(tmp_path):
    fill(tmp_path)
    info = json.loads((tmp_path / "meta/info.json").read_text())
    table = pq.read_table(tmp_path / "data/chunk-000/file-001.parquet")
    # LeRobot casts every file to the features of info.json: the names have to be the same
    assert set(table.column_names) == set(info["features"])
    columns = table.select(
        ["timestamp", "frame_index", "episode_index", "index", "task_index", "next.done", "next.success"]
    ).to_pydict()
    assert columns["episode_index"] == [2] * 7 + [3] * 8
    assert columns["frame_index"] == [*range(7), *range(8)]
    assert columns["index"] == list(range(11, 26))
    assert columns["next.done"] == [i in (6, 14) for i in range(15)]
    assert columns["next.success"] == [i == 6 for i in range(15)]
    assert columns["timestamp"][3] == pytest.approx(3 / 50)
    episode = pq.read_table(tmp_path / "meta/episodes/chunk-000/file-001.parquet").to_pylist()[1]
    assert (episode["dataset_from_index"], episode["dataset_to_index"], episode["length"]) == (18, 26, 8)
    assert (episode["data/chunk_index"], episode["data/file_index"], episode["meta/episodes/file_index"]) == (0, 1, 1)
    assert (episode["tasks"], episode["object_id"], episode["reference_id"]) == (
        ["sit-chair"],
        "chair-0-00001",
        "clip-00003",
    )


def test_statistics(tmp_path):
    fill(tmp_path)
    stats = json.loads((tmp_path / "meta/stats.json").read_text())
    actions = load_demos(tmp_path, only_success=False).action
    for key in ("mean", "std", "min", "max"):
        np.testing.assert_allclose(stats["action"][key], getattr(actions.astype(float), key)(0), atol=1e-6)
    assert stats["action"]["count"] == [35]
    lengths = np.array([5, 6, 7, 8, 9])
    parts = np.split(actions.astype(float), np.cumsum(lengths)[:-1])
    for key, q in (("q01", 0.01), ("q10", 0.1), ("q50", 0.5), ("q90", 0.9), ("q99", 0.99)):
        merged = sum(n * np.quantile(part, q, axis=0) for n, part in zip(lengths, parts, strict=True)) / 35
        np.testing.assert_allclose(stats["action"][key], merged, atol=1e-6)


def test_what_lerobots_policies_see(tmp_path):
    """The object in numbers, by name, and pictures, whose statistics are of pixels from 0 to 1."""
    names, random = [f"n{i}" for i in range(12)], np.random.default_rng(0)
    out, all_pictures, all_scenes = writer(tmp_path, names={"observation.environment_state": names}), [], []
    for number in range(3):
        frames = 4 + number
        picture = random.integers(0, 256, (frames, 16, 20)).astype(np.uint8)
        scene = random.normal(size=(frames, 12)).astype(np.float32)
        out.add(replace(demo(number, frames), scene=scene, picture=picture))
        all_pictures.append(picture)
        all_scenes.append(scene)
    out.finish()
    features = json.loads((tmp_path / "meta/info.json").read_text())["features"]
    assert features["observation.environment_state"] == {"dtype": "float32", "shape": [12], "names": names}
    channels = ["height", "width", "channels"]
    assert features["observation.images.elevation"] == {"dtype": "image", "shape": [16, 20, 3], "names": channels}
    table = pq.read_table(tmp_path / "data/chunk-000/file-000.parquet")
    assert set(table.column_names) == set(features)
    stored = [iio.imread(one["bytes"]) for one in table["observation.images.elevation"].to_pylist()]
    assert (np.array(stored) == np.concatenate(all_pictures[:2])[..., None]).all() and stored[0].shape == (16, 20, 3)
    scenes = np.array(table["observation.environment_state"].to_pylist(), np.float32)
    assert (scenes == np.concatenate(all_scenes[:2])).all()
    stats = json.loads((tmp_path / "meta/stats.json").read_text())["observation.images.elevation"]
    pixels = np.concatenate(all_pictures) / 255
    for key in ("mean", "std", "min", "max"):
        np.testing.assert_allclose(stats[key], np.full((3, 1, 1), getattr(pixels, key)()), atol=1e-6)
    assert stats["count"] == [15] and np.shape(stats["q99"]) == (3, 1, 1)
    assert load_demos(tmp_path).episodes == 3
    with pytest.raises(MimicbenchError, match="with other columns"):
        more = writer(tmp_path)
        for number in range(3, 5):
            more.add(demo(number))


def test_round_trip(tmp_path):
    found = load_demos(fill(tmp_path), "h1")
    assert found.reference_ids == ("clip-00000", "clip-00001", "clip-00002", "clip-00004")
    assert found.starts.tolist() == [0, 5, 11, 18, 27]
    assert (found.robot, found.task, found.fps, found.joint_names) == ("h1", "sit-chair", 50, JOINTS)
    last = demo(4, 9)
    assert (found.qpos[18:] == last.qpos).all() and (found.qvel[18:] == last.qvel).all()
    assert (
        found.state is not None
        and (found.state[18:] == last.state).all()
        and (found.executed_action[18:] == last.executed_action).all()
    )
    everything = load_demos(tmp_path, state=False, only_success=False)
    assert everything.state is None and everything.success.tolist() == [True, True, True, False, True]


def test_killed_and_resumed_gives_the_same_bytes(tmp_path):
    whole, broken = fill(tmp_path / "whole"), tmp_path / "broken"
    out = writer(broken)
    for number in range(3):
        out.add(demo(number, 5 + number, success=number != 3))
    # killed with one episode waiting, and after the frames of the second shard but before its episodes
    (broken / "data/chunk-000/file-001.parquet").write_bytes(b"half")
    again = writer(broken)
    assert again.written == ("clip-00000", "clip-00001")
    for number in range(2, 5):
        again.add(demo(number, 5 + number, success=number != 3))
    again.finish()
    files = [path.relative_to(whole) for path in whole.rglob("*") if path.is_file()]
    assert all((whole / path).read_bytes() == (broken / path).read_bytes() for path in files)


@pytest.mark.parametrize("lost", ["meta/info.json", "meta/digests.json", "stale"])
def test_killed_while_the_data_set_was_described(lost, tmp_path):
    """The next one goes on as if nothing had happened; where no word was left, the first ones are made again."""
    whole, broken = fill(tmp_path / "whole", 4), tmp_path / "broken"
    out = writer(broken)
    for number in range(2):
        out.add(demo(number, 5 + number))
    if lost == "stale":
        before = {path: path.read_bytes() for path in (broken / "meta").glob("*.json")}
        for number in range(2, 4):
            out.add(demo(number, 5 + number, success=number != 3))
        for path, content in before.items():
            path.write_bytes(content)
    else:
        (broken / "meta/digests.json").unlink()
        (broken / lost).unlink(missing_ok=True)
    again = writer(broken)
    assert len(again.written) == {"meta/info.json": 0, "meta/digests.json": 2, "stale": 4}[lost]
    for number in range(len(again.written), 4):
        again.add(demo(number, 5 + number, success=number != 3))
    files = [path.relative_to(whole) for path in whole.rglob("*") if path.is_file()]
    assert all((whole / path).read_bytes() == (broken / path).read_bytes() for path in files)


def test_a_table_of_episodes_without_what_is_read(tmp_path):
    fill(tmp_path)
    path = tmp_path / "meta/episodes/chunk-000/file-000.parquet"
    write_table(path, read_table(path).drop_columns(["success"]))
    (tmp_path / "meta/digests.json").unlink()
    with pytest.raises(BadFile, match="has no column 'success'"):
        load_demos(tmp_path)


@pytest.mark.parametrize("name", ["episode_index", "length", "data/file_index"])
@pytest.mark.parametrize("value", [None, "many"])
def test_a_table_of_episodes_with_something_else_than_numbers(tmp_path, name, value):
    fill(tmp_path)
    path = tmp_path / "meta/episodes/chunk-000/file-000.parquet"
    table = read_table(path)
    odd = pa.array([value] * table.num_rows, pa.string())
    write_table(path, table.set_column(table.schema.get_field_index(name), name, odd))
    (tmp_path / "meta/digests.json").unlink()
    with pytest.raises(BadFile, match=f"something else than whole numbers in '{name}'"):
        load_demos(tmp_path)


def test_a_table_without_tasks(tmp_path):
    fill(tmp_path)
    path = tmp_path / "meta/tasks.parquet"
    write_table(path, read_table(path).slice(0, 0))
    (tmp_path / "meta/digests.json").unlink()
    with pytest.raises(BadFile, match="names no tasks"):
        load_demos(tmp_path)


def test_cut_off_shard(tmp_path):
    fill(tmp_path)
    path = tmp_path / "data/chunk-000/file-001.parquet"
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(BadFile, match="file-001.parquet is not as it was written"):
        load_demos(tmp_path)


def test_wrong_use(tmp_path):
    with pytest.raises(BadFile, match="run `mimicbench demos` first"):
        load_demos(tmp_path)
    fill(tmp_path)
    with pytest.raises(BadFile, match="of robot 'h1', not of 'g1'"):
        load_demos(tmp_path, "g1")
    with pytest.raises(MimicbenchError, match="another robot, task or rate"):
        writer(tmp_path, task="lift-box")
    with pytest.raises(MimicbenchError, match="clip-00000 is not usable: qvel"):
        writer(tmp_path / "new").add(replace(demo(0), qvel=np.full((7, 25), np.nan)))


def test_the_gains_that_they_were_made_with(tmp_path):
    unsaid = load_demos(fill(tmp_path / "unsaid"))
    assert unsaid.gains is None, "as of before they were recorded"
    found = {None: unsaid}
    for gains in ("paper", "improved"):
        out = writer(tmp_path / gains, gains=gains)
        out.add(demo(0))
        out.finish()
        found[gains] = load_demos(tmp_path / gains)
        assert found[gains].gains == recorded_gains(tmp_path / gains) == gains
    with pytest.raises(MimicbenchError, match="or by other gains; write these to another folder"):
        writer(tmp_path / "paper", gains="improved")
    assert unsaid.joined(found["paper"], found["paper"]).gains == "paper"
    with pytest.raises(MimicbenchError, match="by the gains improved and paper cannot be learned from together"):
        unsaid.joined(found["paper"], found["improved"])


@pytest.mark.parametrize(
    "name", ["/dev/zero", "../outside.json", "meta", "data/../../outside.json", "HERE/meta/outside.json"]
)
def test_digests_lead_nowhere_else(name, tmp_path):
    """Who wrote them may be a stranger: what is not a file of the data set is not read."""
    fill(tmp_path / "set")
    (tmp_path / "meta").mkdir()
    for outside in (tmp_path / "outside.json", tmp_path / "meta" / "outside.json"):
        outside.write_text("{}")
    name = name.replace("HERE", str(tmp_path))
    write_record(tmp_path / "set" / "meta" / "digests.json", {name: digest_of(tmp_path / "outside.json")})
    with pytest.raises(BadFile, match="is not as it was written"):
        load_demos(tmp_path / "set")


def test_every_flipped_bit_of_a_shard_is_noticed(tmp_path):
    fill(tmp_path)
    path, random = tmp_path / "data/chunk-000/file-000.parquet", np.random.default_rng(0)
    whole = path.read_bytes()
    (tmp_path / "meta/digests.json").unlink()  # without the digests beside them, by the checksums of the pages
    reads = 0
    for place in random.integers(4, len(whole) * 3 // 4, 30):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        try:
            load_demos(tmp_path)
            reads += 1
        except BadFile as error:
            assert "\n" not in str(error)
    assert reads <= 3, "only headers of pages, which change nothing that is read"


def test_a_shard_that_was_cut_off_before_its_episodes_gets_its_digest_when_it_is_whole(tmp_path):
    out = writer(tmp_path)
    for number in range(2):
        out.add(demo(number))
    orphan = tmp_path / "data/chunk-000/file-001.parquet"
    orphan.write_bytes(b"half")
    again = writer(tmp_path)
    again.finish()
    for number in range(2, 4):
        again.add(demo(number))
    assert load_demos(tmp_path).episodes == 4
