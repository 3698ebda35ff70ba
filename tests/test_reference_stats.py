"""Statistics of clips: figures worked out by hand, and people whose walk is known because it was made so."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import making
from mimicbench.benchmark.finding import largest, stage_with
from mimicbench.commands.references import remake as remake_command
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import read_record, write_record
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.families.bed import make_bed
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.families.sofa import make_sofa
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.body.posing import Trunk, pose
from mimicbench.references.checks.gait_measures import measure_gait, summarize, walking_model
from mimicbench.references.checks.stats import object_size, pairwise, set_statistics, spread
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.route import Route
from mimicbench.references.locomotion.walking import FPS, walk
from mimicbench.references.make import remake
from mimicbench.references.paper import PAPER_SETS
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.report.dataset import dataset_picture, statistics_table, variety_table
from mimicbench.report.table import to_markdown
from mimicbench.tasks.registry import TASKS

DATA = Path(__file__).parents[1].parent / "shared" / "data"


@pytest.fixture(scope="module")
def workdir(tmp_path_factory) -> Path:
    """Six clips of sitting on chairs."""
    root = tmp_path_factory.mktemp("work")
    making.make("references", root, making.small(objects=4, clips=6))
    return root


def stage_of(workdir: Path, name: str) -> Path:
    """The only folder of a stage."""
    (found,) = (workdir / "sit-chair" / name).glob("*")
    return found


def straight_walk(speed: float, metres: float = 5.0) -> HumanMotion:
    """Somebody who walks straight ahead."""
    body = unihsi_body()
    way = walk(
        body,
        Route(np.array([[0.0, 0.0], [metres, 0.0]])),
        0.0,
        np.array([metres + 0.1, 0.0]),
        0.0,
        Gait(speed=speed),
        1.0,
    )
    pelvis = way.pelvis_quat(np.zeros(len(way.time)))
    chest = rot.multiply(pelvis, way.chest_turn(np.full(len(way.time), 0.1)))
    quat = pose(body, Trunk(way.pelvis_pos_w, pelvis, chest, chest), way.legs(), way.arms(body, 1.0))
    return HumanMotion("walk", "walk", body.skeleton, FPS, way.pelvis_pos_w, quat, "none")


def test_pairs_by_hand():
    places = np.array([[[0.0, 0.0]], [[3.0, 4.0]], [[0.0, 4.0]]])  # distances 5, 4, 3
    assert pairwise(places) == pytest.approx(4.0) and pairwise(places[:1]) == 0.0
    assert spread(np.array([1.0, 3.0, np.nan])) == (2.0, 1.0) and np.isnan(spread(np.array([np.nan]))[0])


def test_length_of_a_sofa_is_its_long_side():
    for obj, axes in ((make_chair(1, 0), (0, 1, 2)), (make_sofa(1, 0), (1, 0, 2)), (make_bed(1, 0), (0, 1, 2))):
        low, high = obj.bounds()
        assert object_size(obj) == pytest.approx(tuple(100 * (high - low)[list(axes)]))


def test_the_paper_has_23_thousand_clips():
    assert list(PAPER_SETS) == list(TASKS)
    assert (
        sum(row.clips for row in PAPER_SETS.values()) == 23_490
        and sum(row.objects for row in PAPER_SETS.values()) == 10_580
    )


def test_statistics_are_those_of_the_clips(workdir: Path):
    found = set_statistics("sit-chair", stage_of(workdir, "objects"), stage_of(workdir, "references"))
    motions = [HumanMotion.load(path) for path in sorted((stage_of(workdir, "references")).glob("*.npz"))]
    assert (found.objects, found.clips) == (4, 6)
    assert found.duration == pytest.approx(
        (np.mean([m.duration for m in motions]), np.std([m.duration for m in motions]))
    )
    sizes = np.array([object_size(make_chair(i, 0)) for i in range(4)])
    assert [found.length[0], found.width[0], found.height[0]] == pytest.approx(sizes.mean(0))
    assert found.variety.style["speed"][0] == pytest.approx(np.mean([m.style["speed"] for m in motions]))
    assert (
        1.5 < found.variety.stature[0] < 1.95
        and 0.03 < found.variety.final_pose < 0.5
        and 0 < found.variety.middle_pose < 0.5
    )
    assert found.variety.start_distance[0] == pytest.approx(
        np.mean([np.linalg.norm(m.root_pos_w[0, :2]) for m in motions]), abs=1e-6
    )
    json.dumps(found.to_dict(), allow_nan=False)
    text = to_markdown(statistics_table([found])) + to_markdown(variety_table([found]))
    assert "| SC   | here  |       4 |" in text and "| SC   | paper |    4600 |" in text


def test_picture_is_the_same_every_time(workdir: Path, tmp_path: Path):
    found = set_statistics("sit-chair", stage_of(workdir, "objects"), stage_of(workdir, "references"))
    for name in ("a.png", "b.png"):
        dataset_picture([found], tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_no_clips_no_statistics(tmp_path: Path):
    with pytest.raises(BadFile, match="mimicbench references"):
        set_statistics("sit-chair", tmp_path, tmp_path)


def test_commands_print_and_remake(workdir: Path, tmp_path: Path):
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "mimicbench.cli", "references", *arguments, "--workdir", str(workdir)]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=60, check=False)

    shown = run("stats", "--json", "--picture", "plots.png")
    assert shown.returncode == 0, shown.stderr
    data = json.loads(shown.stdout)["sit-chair"]
    assert data["clips"] == 6 and data["paper"]["clips"] == 5000 and (tmp_path / "plots.png").stat().st_size > 5000
    name = sorted(stage_of(workdir, "references").glob("*.npz"))[2]
    again = run("remake", name.stem, "--json")
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["rejected_for"] == [] and (tmp_path / name.name).read_bytes() == name.read_bytes()
    wrong = run("remake", "sit-chair-9-00001")
    assert wrong.returncode == 2 and "names no synthetic clip" in wrong.stderr and "Traceback" not in wrong.stderr


def test_a_named_stage_brings_its_objects_along(workdir: Path, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = stage_of(workdir, "references")
    name = sorted(folder.glob("*.npz"))[1]
    remake_command(name.stem, stage=folder)
    assert Path(name.name).read_bytes() == name.read_bytes()
    with pytest.raises(BadFile, match="is a stage 'objects', made from no objects; give another --stage"):
        remake_command(name.stem, stage=stage_of(workdir, "objects"))


def test_made_clips_are_none_of_a_set_that_has_a_name(workdir: Path, tmp_path: Path):
    """Variants bear the ids of their originals, and there are more of them."""
    shutil.copytree(workdir, tmp_path / "work")
    folder = stage_of(tmp_path / "work", "references")
    with making.by_hand(folder.with_name("augmented")) as stage:
        for path in folder.glob("*.npz"):
            shutil.copy(path, stage.folder)
            shutil.copy(path, stage.folder / f"{path.stem}~mirror.npz")
        stage.finish()
    assert largest(tmp_path / "work", ["sit-chair"], "references", None)["sit-chair"].folder == folder
    assert largest(tmp_path / "work", ["sit-chair"], "references", "augmented")["sit-chair"].folder == stage.folder
    name = sorted(folder.glob("*.npz"))[1].name
    again = (tmp_path / "work", "sit-chair", "references", name, None)
    assert stage_with(*again, made_alone=True).folder == folder
    with pytest.raises(MimicbenchError, match="say which one with --stage"):
        stage_with(*again)
    shutil.rmtree(folder)
    with pytest.raises(BadFile, match=r"no references that are made of sit-chair; .* \(--source augmented\)"):
        largest(tmp_path / "work", ["sit-chair"], "references", None)


def test_rejected_clips_are_replaced_and_counted(tmp_path: Path):
    objects = making.make("objects", tmp_path)
    stage = making.references_by(tmp_path / "references", objects, every_other, 4)
    summary = stage.header["summary"]
    names = sorted(path.stem for path in (tmp_path / "references").glob("*.npz"))
    assert summary["kept"] == len(names) == 4 and summary["tried"] >= 7 and "K " in summary["rejected_for"]
    assert all(int(name[-5:]) % 2 == 0 for name in names)
    motion, wrong = remake(stage, objects.folder, "sit-chair-0-00001", every_other)
    assert "K" in wrong and motion.id == "sit-chair-0-00001"


def test_what_is_missing_is_made_again_the_same(tmp_path: Path):
    folder, objects = tmp_path / "references", making.make("objects", tmp_path)
    first = making.references_by(folder, objects, every_other, 4)
    bytes_of = {path.name: path.read_bytes() for path in folder.glob("*.npz")}
    (folder / sorted(bytes_of)[1]).unlink()  # as if killed before it
    write_record(folder / "header.json", {**first.header, "complete": False, "summary": {}})
    again = making.references_by(folder, objects, every_other, 4)
    assert again.header == read_record(folder / "header.json") == first.header
    assert {path.name: path.read_bytes() for path in folder.glob("*.npz")} == bytes_of


def every_other(motion: HumanMotion, obj: object) -> bool:
    """A K that holds for even numbers."""
    return int(motion.id[-5:]) % 2 == 0


def test_steps_are_measured_as_they_were_made():
    gait = Gait(speed=0.6)
    found = measure_gait(straight_walk(0.6, 12.0))
    assert found.speed == pytest.approx(0.6, rel=0.05) and found.cadence == pytest.approx(60 / gait.period, rel=0.04)
    assert found.step_length == pytest.approx(0.6 * gait.period, rel=0.05) and found.step_width == pytest.approx(
        gait.width, abs=0.02
    )
    assert 0.2 < found.double_support < 0.5 and 10 < found.hip_range < 60 and 20 < found.knee_range < 80
    assert 0 < found.walking_lean < 10 and np.isnan(found.sit_time)


def test_measures_do_not_depend_on_rate_place_or_side():
    motion = straight_walk(0.6)
    first = measure_gait(motion)
    turn = rot.from_yaw(np.array(2.0))
    quat = motion.local_quat.copy()
    quat[:, 0] = rot.multiply(turn, quat[:, 0])
    moved = measure_gait(replace(motion, local_quat=quat, root_pos_w=rot.rotate(turn, motion.root_pos_w) + [1, 2, 0]))
    faster = measure_gait(
        replace(
            motion,
            fps=60.0,
            root_pos_w=rot.resample(motion.root_pos_w, 30, 60),
            local_quat=rot.resample_quat(motion.local_quat, 30, 60),
        )
    )
    for name in ("speed", "cadence", "step_length", "hip_range", "knee_range"):
        assert getattr(moved, name) == pytest.approx(getattr(first, name), rel=1e-6), name
        assert getattr(faster, name) == pytest.approx(getattr(first, name), rel=0.03), name


def test_sitting_down_is_measured():
    motion = synthesize("sit-chair", 3, make_chair(3, 0), 0)
    found = measure_gait(motion)
    assert 0.5 * motion.style["sit_duration"] < found.sit_time < motion.style["sit_duration"]
    assert (
        np.degrees(motion.style["lean"]) - 5 < found.sit_lean < np.degrees(motion.style["lean"]) + 5
        and 50 < found.seated_knee < 115
    )
    mean, deviation, count = summarize([found, found])["sit_time"]
    assert mean == pytest.approx(found.sit_time) and deviation == 0 and count == 2


def test_model_of_usual_walking():
    usual = walking_model(1.3, 0.89)  # 108 steps/min, 72 cm, a quarter of the time on both feet
    assert usual == pytest.approx({"cadence": 107.75, "step_length": 0.7239, "double_support": 0.2472}, rel=1e-3)
    assert usual["cadence"] / 60 * usual["step_length"] == pytest.approx(1.3)


@pytest.mark.skipif(not DATA.exists(), reason="no real recordings here")
def test_real_people_walk_as_the_model_says():
    from mimicbench.references.importers.unihsi import import_skeleton_motion

    recording = import_skeleton_motion(DATA / "unihsi" / "motion_clips" / "lie_down.npy")
    motion = HumanMotion(
        recording.name, "walk", recording.skeleton, recording.fps, recording.root_pos_w, recording.local_quat, "none"
    )
    found = measure_gait(motion)
    model = walking_model(found.speed, 0.83)
    assert found.cadence == pytest.approx(model["cadence"], rel=0.2) and found.double_support == pytest.approx(
        model["double_support"], abs=0.08
    )
