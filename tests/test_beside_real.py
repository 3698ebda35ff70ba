"""The judge that tells synthetic people from real ones: numbers worked out by hand, and people who differ because they
were made so.
"""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import making
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.registry import FAMILIES
from mimicbench.references.body.body import body_of, unihsi_body
from mimicbench.references.body.skeletons import UNIHSI
from mimicbench.references.checks.beside_real import judge, person_of, read_recordings
from mimicbench.references.checks.boosting import area_under_curve, fit_stumps, unseen_area
from mimicbench.references.checks.features import window_features
from mimicbench.references.checks.gait_measures import walking_model
from mimicbench.references.checks.people_measures import measure_people, share_within, strides_of
from mimicbench.references.checks.phases import phases_of
from mimicbench.references.checks.signals import LEG, signals_of
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.straight import clip_of_walk, straight_way
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.report.beside_real import features_table, judgement_table, measures_table
from mimicbench.tasks.registry import TASKS

DATA = Path(__file__).parents[1].parent / "shared" / "data"


def clip(task: str, index: int) -> HumanMotion:
    return synthesize(task, index, FAMILIES.get(TASKS.get(task).family).make(index, 0), 0)


@pytest.fixture(scope="module")
def sitters() -> list[HumanMotion]:
    return [clip("sit-chair", index) for index in range(8)]


def arms_out(motion: HumanMotion, angle: float) -> HumanMotion:
    """The same motion with the upper arms turned away from the body [rad]."""
    quat = motion.local_quat.copy()
    for arm, sign in zip(body_of(motion.skeleton).arms, (1, -1), strict=True):
        quat[:, arm.root] = rot.multiply(rot.from_rotvec(np.array([sign * angle, 0, 0])), quat[:, arm.root])
    return replace(motion, local_quat=quat)


def statue(frames: int = 60, fps: float = 30.0) -> HumanMotion:
    quat = np.tile(rot.IDENTITY, (frames, 15, 1))
    height = body_of(UNIHSI).standing_height
    return HumanMotion("statue", "none", UNIHSI, fps, np.tile([0.0, 0.0, height], (frames, 1)), quat, "none")


def test_area_by_hand():
    score = np.array([0.1, 0.4, 0.4, 0.9])
    # pairs (kind 1 over kind 0): 0.4 > 0.1, 0.4 = 0.4, 0.9 > 0.1, 0.9 > 0.4: 3.5 of 4
    assert area_under_curve(score, np.array([0, 0, 1, 1])) == pytest.approx(3.5 / 4)
    assert area_under_curve(-score, np.array([0, 0, 1, 1])) == pytest.approx(0.5 / 4)


def test_stumps_find_a_band_that_no_line_does():
    random = np.random.default_rng(0)
    rows = random.standard_normal((600, 5))
    kind = (np.abs(rows[:, 2]) < 0.6).astype(float)
    fresh = random.standard_normal((600, 5))
    score = fit_stumps(rows, kind).score(fresh)
    assert area_under_curve(score, (np.abs(fresh[:, 2]) < 0.6).astype(float)) > 0.95


def test_whom_a_group_belongs_to_does_not_count():
    """Every group has its own offset: within groups kinds are told with certainty, over unseen groups not at all."""
    random = np.random.default_rng(0)
    groups = np.repeat(np.arange(40), 15)
    offset = random.standard_normal(40)
    kind = (groups % 2).astype(float)
    rows = np.stack([offset[groups], random.standard_normal(len(groups))], -1)
    assert area_under_curve(fit_stumps(rows, kind).score(rows), kind) > 0.8
    assert 0.2 < unseen_area(rows, kind, groups, 5) < 0.8
    assert np.isnan(unseen_area(rows, (groups == 0).astype(float), groups, 5))


def test_signals_do_not_tell_whose_they_are(sitters: list[HumanMotion]):
    motion = sitters[0]
    plain = signals_of(motion)
    turn = rot.from_yaw(np.array(1.1))
    quat = motion.local_quat.copy()
    quat[:, 0] = rot.multiply(turn, quat[:, 0])
    moved = rot.rotate(turn, motion.root_pos_w) + np.array([3.0, -2.0, 0.0])
    others = (
        replace(motion, root_pos_w=moved, local_quat=quat),
        replace(motion, skeleton=motion.skeleton.scaled(1.2), root_pos_w=1.2 * motion.root_pos_w),
    )
    for other in map(signals_of, others):
        for name, values in (plain.pairs | plain.single).items():
            assert (other.pairs | other.single)[name] == pytest.approx(values, abs=1e-6), name
        assert (other.feet == plain.feet).mean() > 0.95 and other.pose == pytest.approx(plain.pose)


def test_frame_rates_and_noise_hardly_count(sitters: list[HumanMotion]):
    motion = sitters[0]
    fast = replace(
        motion,
        fps=60.0,
        root_pos_w=rot.resample(motion.root_pos_w, motion.fps, 60.0),
        local_quat=rot.normalize(rot.resample_quat(motion.local_quat, motion.fps, 60.0)),
        contact_names=(),
        contacts=np.zeros((0, 0), bool),
    )
    assert motion.fps != 60.0
    names, slow = window_features(signals_of(motion))
    _, quick = window_features(signals_of(fast))
    few = min(len(slow), len(quick))
    for name in ("knee flexion, mean", "knee flexion, rate", "trunk pitch, deviation", "speed forward, mean"):
        i = names.index(name)
        assert quick[:few, i] == pytest.approx(slow[:few, i], rel=0.05, abs=0.05 * slow[:, i].std()), name


def test_angles_by_hand():
    still = signals_of(arms_out(statue(), 0.3))
    assert still.pairs["upper arm out"] == pytest.approx(np.degrees(0.3), abs=1e-6)
    assert still.single["pelvis height"] == pytest.approx(LEG) and still.single["trunk pitch"] == pytest.approx(0)
    assert still.feet.all() and still.pairs["ankle flexion"] == pytest.approx(0, abs=1e-6)
    assert phases_of(still) == [None] * len(phases_of(still))
    names, rows = window_features(still)
    assert rows[:, names.index("speed of all joints, mean")] == pytest.approx(0)
    assert rows[:, names.index("upper arm out, mean")] == pytest.approx(np.degrees(0.3))


@pytest.mark.parametrize(
    ("task", "wanted"),
    [
        ("sit-chair", ["walk", "turn", "sit down", "rest seated"]),
        ("lie-bed", ["walk", "turn", "sit down", "lie down", "rest lying"]),
        ("touch-points", ["reach"]),
        ("lift-box", ["reach", "lift"]),
    ],
)
def test_phases_come_in_the_order_of_the_task(task: str, wanted: list[str]):
    found = [person_of(clip(task, index)).phases for index in range(4)]
    assert {phase for phases in found for phase in phases if phase} >= set(wanted)
    for phases in found:
        firsts = [phases.index(phase) for phase in wanted if phase not in ("walk", "turn", "reach") and phase in phases]
        assert firsts == sorted(firsts)
        if task in ("touch-points", "lift-box"):
            assert not {"rest seated", "rest lying", "sit down", "lie down"} & set(phases)


def test_who_is_alike_is_not_told_apart(sitters: list[HumanMotion]):
    people = [person_of(motion) for motion in sitters]
    alike = {row.phase: row for row in judge(people[::2], people[1::2])}
    # who begins beside the seat may not walk for a whole window
    assert alike["walk"].recordings >= 3 and alike["walk"].clips >= 3
    assert alike["walk"].area < 0.85
    odd = [person_of(arms_out(motion, 0.4)) for motion in sitters[1::2]]
    apart = {row.phase: row for row in judge(people[::2], odd)}
    for phase in ("walk", "turn"):
        assert apart[phase].area > 0.95
        assert any(one.name == "upper arm out, mean" and one.area > 0.9 for one in apart[phase].features)


def test_statues_are_frozen(sitters: list[HumanMotion]):
    """Whoever stops moving at the end is said to be frozen for longer."""
    motion = sitters[0]
    end = np.r_[np.arange(motion.frames), np.full(90, motion.frames - 1)]
    long = replace(motion, root_pos_w=motion.root_pos_w[end], local_quat=motion.local_quat[end], contact_names=())
    before, after = (measure_people([person_of(each)]) for each in (motion, replace(long, contacts=np.zeros((0, 0)))))
    name = "rest seated, frozen [% of the time]"
    assert after[name][0] > before[name][0] or before[name][0] == 100


def test_strides_within_themselves(sitters: list[HumanMotion]):
    strides = strides_of([person_of(motion) for motion in sitters])
    assert len(strides.curves) > 3
    assert share_within(strides, strides) == {"hip flexion": 1.0, "knee flexion": 1.0, "ankle flexion": 1.0}
    off = replace(strides, curves=strides.curves + 90)
    assert set(share_within(off, strides).values()) == {0.0}


def test_tables_have_a_row_for_everything(sitters: list[HumanMotion]):
    people = [person_of(motion) for motion in sitters]
    found = judge(people[::2], people[1::2])
    assert [row[0] for row in judgement_table(found).rows] == [row.phase for row in found]
    assert len(features_table(found).rows) == sum(len(row.features) for row in found)
    table = measures_table(people[::2], {"sit-chair": people[1::2]})
    assert table.columns == ("", "real", "sit-chair")
    assert any("straighter knee" in str(row[0]) for row in table.rows)


def test_the_page_has_the_words_of_the_tables():
    """Its numbers take recordings to make; what they are called does not."""
    page = (Path(__file__).parents[1] / "docs" / "people-judged.md").read_text()
    headings = [re.split(r" *\| *", line)[1:-1] for line in page.splitlines() if line.startswith("| Phase")]
    tables = judgement_table(()), features_table(())
    assert headings == [list(table.columns) for table in tables]
    assert all(f"**{table.title}**" in page and table.note in page for table in tables)


def test_no_recording_is_said(tmp_path: Path):
    (tmp_path / "notes.txt").write_text("nothing\n")
    said: list[str] = []
    with pytest.raises(BadFile, match="holds no recording"):
        read_recordings(tmp_path, said.append)
    assert len(said) == 1 and "notes.txt" in said[0]


@pytest.mark.skipif(not DATA.is_dir(), reason=f"the real recordings are not at {DATA}")
def test_real_people_go_through_the_phases():
    recordings = read_recordings(DATA / "unihsi" / "motion_clips", print)
    found = {motion.id: set(person_of(motion).phases) for motion in recordings}
    assert {"walk", "turn", "sit down", "rest seated"} <= found["armchair"]
    assert {"sit down", "lie down", "rest lying"} <= found["lie_down"]
    assert not {"sit down", "lie down", "lift", "rest seated"} & found["locomotion_random"]


@pytest.mark.skipif(not DATA.is_dir(), reason=f"the real recordings are not at {DATA}")
def test_the_command_judges(tmp_path: Path, sitters: list[HumanMotion], capsys: pytest.CaptureFixture[str]):
    from mimicbench.commands.references import stats

    with making.by_hand(tmp_path / "sit-chair" / "references" / "given") as stage:
        for motion in sitters:
            motion.save(stage.folder / f"{motion.id}.npz")
        stage.finish()
    paths = tuple(DATA / "unihsi" / "motion_clips" / f"{name}.npy" for name in ("armchair", "armchair002"))
    stats("sit-chair", beside_real=paths, workdir=tmp_path, source="given", as_json=True)
    found = json.loads(capsys.readouterr().out)["phases"]
    assert {row["phase"] for row in found} >= {"walk", "sit down", "rest seated"}
    assert all(0 <= row["area"] <= 1 and row["recordings"] == 2 for row in found)


@pytest.mark.skipif(not DATA.is_dir(), reason=f"the real recordings are not at {DATA}")
def test_the_gait_is_that_of_recordings():
    """Over nine tenths of the stride hips, knees and ankles are within a deviation of the recorded ones."""
    folders = DATA / "unihsi" / "motion_clips", DATA / "omomo"
    real = [person_of(motion) for folder in folders for motion in read_recordings(folder, print)]
    body = unihsi_body(1.08)
    ways = [straight_way(body, Gait(speed=speed), 5.0) for speed in (0.65, 0.75, 0.85)]
    people = [person_of(clip_of_walk(body, way)) for way in ways]
    assert min(share_within(strides_of(people), strides_of(real)).values()) >= 0.9
    measures = measure_people(people)
    assert measures["walking, straighter knee, median [deg]"][0] < 12
    speed = measures["walking, speed [m/s]"][0]
    model = walking_model(speed, sum(body.length(body.legs[0])))
    assert measures["walking, cadence [steps/min]"][0] == pytest.approx(model["cadence"], rel=0.15)
    assert measures["walking, step length [cm]"][0] == pytest.approx(100 * model["step_length"], rel=0.15)
    assert measures["walking, both feet bear [% of the time]"][0] == pytest.approx(32, rel=0.15)
