"""The retargeting methods as a user meets them: the paper's tables, what every method promises, what is kept out and
why, and the comparison.
"""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import making
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile, BadMotion, MimicbenchError, UnknownName
from mimicbench.core.files import read_record
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.skeleton import Skeleton, forward_kinematics
from mimicbench.core.stage import Stage
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.shape import SceneObject, save_object
from mimicbench.references.body.body import body_of
from mimicbench.references.body.skeletons import CORE4D, ROAM, UNIHSI
from mimicbench.references.settings import ReferencesConfig
from mimicbench.report.retargeting import Comparison, MethodResult, measures_table, write_comparison
from mimicbench.retarget.acceptance import MEASURES, PROMISED, Limits, outcome, summary, unsolved
from mimicbench.retarget.baselines.adam import adam
from mimicbench.retarget.baselines.mink_ik import solve_frames
from mimicbench.retarget.baselines.speed import RetargetBenchConfig, bench_retargeting
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.kinematics import Pose, tree_of
from mimicbench.retarget.make import Places, make_retargeted, read_retargeted
from mimicbench.retarget.mapping import bind, find_mapping
from mimicbench.retarget.methods import optimization as opt
from mimicbench.retarget.methods.copy_rotation import copy_rotations
from mimicbench.retarget.methods.omnih2o import align
from mimicbench.retarget.methods.optimization import PAPER
from mimicbench.retarget.registry import METHODS
from mimicbench.retarget.settings import RetargetConfig
from mimicbench.retarget.solver import solve
from mimicbench.robots.description import Robot
from mimicbench.robots.registry import ROBOTS

H1 = ROBOTS.get("h1")
UNIHSI_H1, ROAM_H1, CORE4D_H1 = H1.mappings
TREE = tree_of(H1)
SKELETONS = (UNIHSI, ROAM, CORE4D)
FEET = ("left_foot", "right_foot")


def reach(skeleton: Skeleton, frames: int = 12, obj: SceneObject | None = None) -> HumanMotion:
    """Somebody stands, bends the knees a little and moves both arms forward, with all that a clip can carry."""
    body, t = body_of(skeleton), np.linspace(0, 1, frames)
    quat = np.tile(rot.IDENTITY, (frames, len(skeleton.joint_names), 1))
    bent = np.outer(0.25 + 0.1 * t, [0.0, 1.0, 0.0])
    for leg in body.legs:
        quat[:, leg.root], quat[:, leg.middle], quat[:, leg.end] = (
            rot.from_rotvec(-bent),
            rot.from_rotvec(2 * bent),
            rot.from_rotvec(-bent),
        )
    for arm in body.arms:
        quat[:, arm.root], quat[:, arm.middle] = rot.from_rotvec(-2 * bent), rot.from_rotvec(-4 * bent)
    rest, _ = forward_kinematics(skeleton, np.zeros((frames, 3)), quat)
    root = np.tile([-1.5, 0.0, 0.0], (frames, 1))
    root[:, 2] = body.sole - rest[:, body.legs[0].end, 2]
    obj = obj or make_box(0, 0)
    return HumanMotion(
        f"reach-{skeleton.name}",
        "lift-box",
        skeleton,
        30.0,
        root,
        quat,
        obj.id,
        FEET,
        np.ones((frames, 2), bool),
        {"speed": 0.5},
        "synthetic",
        np.tile([0.5, 0.1, 0.2], (frames, 1)),
        np.tile(rot.IDENTITY, (frames, 1)),
        np.array([[-1.1, 0.3, 1.0], [-1.1, -0.3, 1.0]]),
    )


def legs(robot: Robot) -> tuple[int, int]:
    """Links of one hip and of its foot."""
    hip, _, foot = robot.legs[0]
    return robot.link_names.index(hip), robot.link_names.index(foot)


# --- the paper's tables, to the letter


TABLES = {
    "unihsi": (
        UNIHSI_H1,
        UNIHSI,
        {
            (0, 0),
            (0, 11),
            (12, 1),
            (12, 2),
            (13, 4),
            (14, 5),
            (9, 6),
            (9, 7),
            (10, 9),
            (11, 10),
            (6, 13),
            (7, 15),
            (3, 17),
            (4, 19),
        },
    ),
    "roam": (
        ROAM_H1,
        ROAM,
        {
            (0, 0),
            (0, 11),
            (17, 1),
            (17, 2),
            (18, 4),
            (19, 5),
            (22, 6),
            (22, 7),
            (23, 9),
            (24, 10),
            (10, 12),
            (11, 15),
            (14, 16),
            (15, 19),
        },
    ),
    "core4d": (
        CORE4D_H1,
        CORE4D,
        {
            (0, 0),
            (0, 11),
            (1, 1),
            (1, 2),
            (4, 4),
            (7, 5),
            (2, 6),
            (2, 7),
            (5, 9),
            (8, 10),
            (16, 12),
            (18, 15),
            (17, 16),
            (19, 19),
        },
    ),
}
"""(human joint, H1 joint) by index, as in the appendix's three tables."""


@pytest.mark.parametrize("name", TABLES)
def test_tables_are_the_appendix(name: str) -> None:
    mapping, skeleton, paper = TABLES[name]
    assert find_mapping(name, H1) is mapping
    bound = bind(mapping, skeleton, H1, "paper")
    assert set(zip(bound.joints.tolist(), bound.links.tolist(), strict=True)) == paper and len(bound.links) == 14
    assert (bound.turn_joints == bound.joints).all() and (bound.turn_links == bound.links).all()
    assert (bound.shifts == 0).all() and (bound.weights == 1).all()
    improved = bind(mapping, skeleton, H1, "improved")
    assert set(zip(improved.joints.tolist(), improved.links.tolist(), strict=True)) == paper


@pytest.mark.parametrize("skeleton", SKELETONS, ids=lambda skeleton: skeleton.name)
def test_aligned_skeleton_has_the_robots_limbs(skeleton: Skeleton) -> None:
    aligned = align(skeleton, find_mapping(skeleton.name, H1), H1)
    assert aligned.parents == skeleton.parents and aligned.joint_names == skeleton.joint_names
    rest, _ = forward_kinematics(aligned, np.zeros(3), np.tile(rot.IDENTITY, (len(aligned.joint_names), 1)))
    body = body_of(skeleton)
    for side, leg, arm in zip(("left", "right"), body.legs, body.arms, strict=True):
        # 0.4 m is the H1's shank
        assert np.linalg.norm(rest[leg.middle] - rest[leg.end]) == pytest.approx(0.4, abs=1e-9)
        down = np.array([H1.arms_down.get(name, 0.0) for name in H1.joint_names])
        pos, quat = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, down)
        at = {name: pos[i] for i, name in enumerate(H1.link_names)}
        hip = 0.5 * (at[f"{side}_hip_yaw_link"] + at[f"{side}_hip_roll_link"])
        shoulder = at[f"{side}_shoulder_{'roll' if skeleton is UNIHSI else 'pitch'}_link"]
        wrist = H1.keypoint_pos(f"{side}_wrist", pos, quat)
        elbow, knee = at[f"{side}_elbow_link"], at[f"{side}_knee_link"]
        for joint, place in (
            (leg.root, hip),
            (leg.middle, knee),
            (arm.root, shoulder),
            (arm.middle, elbow),
            (arm.end, wrist),
        ):
            assert rest[joint] == pytest.approx(place, abs=1e-9)


# --- what every method promises


@pytest.mark.parametrize("skeleton", SKELETONS, ids=lambda skeleton: skeleton.name)
@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("of", ROBOTS)
def test_every_method_keeps_its_contract(of: str, name: str, skeleton: Skeleton) -> None:
    box, method, robot = make_box(0, 0), METHODS.get(name), ROBOTS.get(of)
    motion = reach(skeleton, obj=box)
    for preset in method.presets:
        result = method.retarget(Clip(motion, box, robot), preset)
        assert (result.id, result.reference_id, result.task, result.object_id) == (
            motion.id,
            motion.id,
            motion.task,
            box.id,
        )
        assert (result.fps, result.frames, result.robot, result.style) == (
            motion.fps,
            motion.frames,
            of,
            motion.style,
        )
        assert result.contact_names == motion.contact_names and (result.contacts == motion.contacts).all()
        assert (result.wrist_goal_w == motion.wrist_goal_w).all() and (result.object_pos_w == motion.object_pos_w).all()
        assert (result.object_quat_w == motion.object_quat_w).all()
        stored = result.joint_pos.astype(np.float32).astype(float)
        assert (stored >= robot.joint_range[:, 0]).all() and (stored <= robot.joint_range[:, 1]).all()
        assert set(MEASURES) <= set(result.measures)
        # methods of the paper follow the points of a person whom a small robot does not reach up to
        small = {"position_error"} if robot.reach(*legs(robot)) < 0.7 and method.limits == Limits() else set()
        assert set(unsolved({**result.measures, "goal_error": 0.0}, method.limits)) <= small
        again = method.retarget(Clip(motion, box, ROBOTS.get(of)), preset)
        assert (again.joint_pos == result.joint_pos).all() and (again.root_pos_w == result.root_pos_w).all()
        assert dict(again.measures) == dict(result.measures)


@pytest.mark.parametrize("skeleton", SKELETONS, ids=lambda skeleton: skeleton.name)
def test_recovers_what_the_robot_itself_did(skeleton: Skeleton) -> None:
    """From the places and orientations of the links of the skeleton's table alone, at other joint angles to start
    with.
    """
    motion, t = reach(skeleton, 10), np.linspace(0, 1, 10)[:, None]
    bound, limits = bind(find_mapping(skeleton.name, H1), skeleton, H1, "paper"), H1.joint_range
    middle = limits.mean(1)
    truth = Pose(
        np.hstack([t, 0.1 * t, 1 + 0 * t]),
        rot.from_rotvec(np.hstack([0.1 * t, 0.2 * t, t])),
        middle + 0.3 * np.sin(3 * t + np.arange(19)),
    )
    links = TREE.place(truth)
    problem = opt.make_problem(
        bound, TREE, limits, *motion.forward_kinematics(), motion.fps, replace(PAPER, acceleration=1e-9), True
    )
    points = links.pos[:, problem.point_links] + rot.rotate(links.quat[:, problem.point_links], problem.point_offsets)
    problem = replace(problem, point_targets=points, turn_targets=links.quat[:, problem.turn_links])
    found, _ = solve(problem, truth._replace(joints=np.tile(middle, (10, 1))), 80, 1e-10)
    assert np.abs(found.joints - truth.joints).max() < 5e-3
    assert np.abs(found.root_pos - truth.root_pos).max() < 5e-4


def test_wrist_and_pelvis_errors_are_distances_to_the_human() -> None:
    motion = reach(UNIHSI)
    result = METHODS.get("copy-rotation").retarget(Clip(motion, make_box(0, 0), H1), "paper")
    pos, quat = H1.forward_kinematics(result.root_pos_w, result.root_quat_w, result.joint_pos)
    human, _ = motion.forward_kinematics()
    wrists = [
        H1.keypoint_pos(f"{side}_wrist", pos, quat) - human[:, UNIHSI.index(f"{side}_hand")]
        for side in ("left", "right")
    ]
    assert result.measures["wrist_error"] == pytest.approx(np.linalg.norm(wrists, axis=-1).mean())
    assert result.measures["pelvis_error"] == pytest.approx(
        np.linalg.norm(result.root_pos_w - human[:, 0], axis=-1).mean()
    )
    goals = [
        H1.keypoint_pos(f"{side}_wrist", pos, quat) - goal
        for side, goal in zip(("left", "right"), motion.wrist_goal_w, strict=True)
    ]
    assert result.measures["goal_error"] == pytest.approx(np.linalg.norm(goals, axis=-1).max(0).min())


# --- Adam and mink


def test_adam_needs_thousands_of_steps_for_what_the_solver_does_in_ten() -> None:
    motion = reach(UNIHSI, 8)
    bound = bind(UNIHSI_H1, UNIHSI, H1, "paper")
    places = motion.forward_kinematics()
    problem = opt.make_problem(bound, TREE, H1.joint_range, *places, motion.fps, PAPER, True)
    start = copy_rotations(bound, TREE, H1.joint_range, *places)
    ours, losses = solve(problem, start, 30, 1e-4)
    theirs, history = adam(problem, start, 150)
    assert len(losses) < 20 and len(history) == 150
    found = problem.loss(theirs, TREE.place(theirs), softened=False)
    assert problem.loss(ours, TREE.place(ours), softened=False) <= found <= history[0] and found <= min(history)
    assert (theirs.joints >= H1.joint_range[:, 0]).all() and (theirs.joints <= H1.joint_range[:, 1]).all()


def test_gradient_without_the_matrix_is_the_models() -> None:
    motion = reach(UNIHSI, 7)
    bound = bind(UNIHSI_H1, UNIHSI, H1)
    places = motion.forward_kinematics()
    problem = opt.make_problem(bound, TREE, H1.joint_range, *places, motion.fps, opt.OptimizationConfig(), True)
    pose = copy_rotations(bound, TREE, H1.joint_range, *places)
    links = TREE.place(pose)
    assert np.allclose(problem.gradient(pose, links), problem.model(pose, links).gradient, rtol=1e-12, atol=1e-15)


def test_bench_tells_speeds_losses_and_ratios() -> None:
    box = make_box(0, 0)
    clips = {"lift-box": [Clip(reach(UNIHSI, 8), box, H1)]}
    found = json.loads(
        json.dumps(bench_retargeting(clips, {"lift-box": 1e5}, RetargetBenchConfig(3, 8, 1), lambda line: None))
    )
    assert set(found["frames_per_second"]) == set(METHODS) == set(found["two_core_hours"])
    assert all(
        speed["lift-box"] > 0 and speed["all"] == pytest.approx(speed["lift-box"])
        for speed in found["frames_per_second"].values()
    )
    assert found["adam"]["solver_loss"] <= found["adam"]["loss"] and found["ratios"]["solver_over_adam"] > 0
    assert ("left_out" in found["mink"]) or found["ratios"]["solver_over_mink"] > 0


def test_mink_comes_near_the_same_targets() -> None:
    pytest.importorskip("mink")
    motion = reach(UNIHSI, 4)
    bound = bind(UNIHSI_H1, UNIHSI, H1, "paper")
    places = motion.forward_kinematics()
    problem = opt.make_problem(bound, TREE, H1.joint_range, *places, motion.fps, PAPER)
    pose, programs = solve_frames(problem, H1, copy_rotations(bound, TREE, H1.joint_range, *places), steps=20)
    errors = np.linalg.norm(TREE.place(pose).pos[:, bound.links] - places[0][:, bound.joints], axis=-1)
    assert errors.mean() < 0.1 and 1 <= programs <= 20
    assert (pose.joints >= H1.joint_range[:, 0]).all() and (pose.joints <= H1.joint_range[:, 1]).all()


def test_without_mink_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mink", None)
    motion = reach(UNIHSI, 4)
    bound = bind(UNIHSI_H1, UNIHSI, H1, "paper")
    problem = opt.make_problem(bound, TREE, H1.joint_range, *motion.forward_kinematics(), motion.fps, PAPER)
    with pytest.raises(MimicbenchError, match=r"pip install 'mimicbench\[bench\]'"):
        solve_frames(problem, H1, copy_rotations(bound, TREE, H1.joint_range, *motion.forward_kinematics()))


# --- what is kept out


def test_verdict_by_hand() -> None:
    good: dict[str, float] = {name: 0.0 for name in MEASURES}
    assert unsolved(good, Limits()) == [] == unsolved({**good, "depth": 0.2, "velocity_ratio": 1.0}, Limits())
    assert unsolved({**good, "depth": 0.2}, PROMISED) == ["depth"]
    assert unsolved({**good, "goal_error": 0.11, "position_error": 0.3}, Limits()) == ["position_error", "goal_error"]
    assert (
        unsolved({**good, "skate": float("nan")}, Limits())
        == ["not_finite"]
        == unsolved({**good, "skate": float("inf")}, Limits())
    )
    cases = [
        ({**good, "contact_kept": 1.0}, True),
        ({**good, "contact_kept": 0.5}, False),
        ({**good, "contact_kept": 0.9, "velocity_ratio": 2.0}, True),
    ]
    found = summary([outcome(measures, fulfilled, 10, Limits()) for measures, fulfilled in cases])
    assert (found.clips, found.frames, found.fulfilled, found.kept) == (3, 30, 2, 1)
    assert (
        found.rejected_for == {"K": 1, "velocity_ratio": 1}
        and found.k_rate == pytest.approx(2 / 3)
        and found.rate == pytest.approx(1 / 3)
    )
    assert (
        found.measures["contact_kept"] == {"mean": pytest.approx(0.8), "worst": 0.5}
        and found.measures["velocity_ratio"]["worst"] == 2.0
    )


def given(workdir: Path, motions: list[HumanMotion], obj: SceneObject) -> Stage:
    """The set `given` of clips and of one object."""
    with making.by_hand(workdir / "lift-box" / "objects" / "given", "objects", "lift-box") as stage:
        save_object(stage.folder, obj)
        stage.finish(count=1)
    reads = {"objects": stage.folder}
    more = {"reads": reads, "made_from": {"objects": stage.fingerprint}}
    with making.by_hand(workdir / "lift-box" / "references" / "given", "references", "lift-box", **more) as stage:
        for motion in motions:
            motion.save(stage.folder / f"{motion.id}.npz")
        return stage.finish(kept=len(motions))


def retargeted(workdir: Path, references: Stage, name: str = "retarget", method: str = "optimization") -> Stage:
    """The clips of the set, every one of which fulfils K."""
    with making.by_hand(workdir / name, "retarget", "lift-box") as stage:
        places = Places("h1", workdir / "lift-box" / "objects" / "given", always)
        clips = sorted(references.folder.glob("*.npz"))
        return make_retargeted(stage, clips, places, RetargetConfig(method=method), making.QUIET)


def always(motion: RobotMotion, obj: SceneObject, robot: object) -> bool:
    return True


def test_unreachable_goals_end_here(tmp_path: Path) -> None:
    box = make_box(0, 0)
    near = reach(UNIHSI, 20, box)
    far = replace(near, id="far", wrist_goal_w=near.wrist_goal_w + [5.0, 0.0, 0.0])
    pos, _ = near.forward_kinematics()
    near = replace(near, id="near", wrist_goal_w=pos[-1, [UNIHSI.index("left_hand"), UNIHSI.index("right_hand")]])
    stage = given(tmp_path, [near, far], box)
    for _ in range(2):  # the second time everything is there already
        made = retargeted(tmp_path, stage)
        told = made.summary
        assert (told["clips"], told["fulfilled"], told["kept"], told["rejected_for"]) == (2, 2, 1, {"goal_error": 1})
        assert [motion.id for motion in read_retargeted(made.folder, "h1")] == ["near"]
        marked = RobotMotion.load(made.folder / "far.npz", "h1")
        assert not marked.success and marked.measures["fulfilled"] == 1.0 and marked.measures["goal_error"] > 0.1
        header = read_record(made.folder / "header.json")
        assert isinstance(header, dict)
        (made.folder / "header.json").write_text(json.dumps({**header, "complete": False}))
    alone = tmp_path / "alone"
    given(alone, [far], box)
    recipe = making.Recipe(
        "lift-box", references=ReferencesConfig("given"), retarget=RetargetConfig(method="copy-rotation")
    )
    with pytest.raises(BadMotion, match="goal_error 1"):
        making.make("retarget", alone, recipe)


def test_bad_input_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        UnknownName,
        match=r"unknown retargeting method 'guess'; known are: copy-rotation, interaction, omnih2o, optimization",
    ):
        METHODS.get("guess")
    assert METHODS.get("omnih2o").preset(None) == "paper" and METHODS.get("interaction").preset(None) == "improved"
    with pytest.raises(MimicbenchError, match="omnih2o has no variant 'improved'"):
        METHODS.get("omnih2o").preset("improved")
    box = make_box(0, 0)
    stage = given(tmp_path, [], box)
    with pytest.raises(BadMotion, match="there are no clips"):
        making.make("retarget", tmp_path, making.Recipe("lift-box", references=ReferencesConfig("given")))
    with pytest.raises(BadMotion, match="has 0 frames"):
        reach(UNIHSI, 0)
    motion = reach(UNIHSI, 4, box)
    path = stage.folder / "short.npz"
    motion.save(path)
    with np.load(path) as data:
        arrays = {
            name: data[name][:0] if name in ("root_pos_w", "local_quat", "contacts") else data[name]
            for name in data.files
        }
    np.savez(path, **arrays)
    with pytest.raises((BadMotion, BadFile), match=r"0 frames|short\.npz"):
        retargeted(tmp_path, stage)
    replace(motion, id="short", skeleton=replace(UNIHSI, name="centaur")).save(path)
    with pytest.raises(UnknownName, match="unknown skeleton for h1 .centaur."):
        retargeted(tmp_path, stage)


def test_a_wild_clip_is_marked_and_not_passed_on(tmp_path: Path) -> None:
    box = make_box(0, 0)
    wild = reach(UNIHSI, 6, box)
    wild = replace(wild, id="wild", root_pos_w=wild.root_pos_w + 1e30 * np.arange(6)[:, None])
    made = retargeted(tmp_path, given(tmp_path, [reach(UNIHSI, 6, box), wild], box))
    told = made.summary
    assert not RobotMotion.load(made.folder / "wild.npz").success and told["rejected_for"] and told["kept"] < 2
    assert "Infinity" not in (made.folder / "header.json").read_text()


def test_command_line(tmp_path: Path) -> None:
    box = make_box(0, 0)
    held = reach(UNIHSI, 8, box)
    given(
        tmp_path / "work",
        [replace(held, wrist_goal_w=np.zeros((0, 3)), object_pos_w=held.object_pos_w + [0.0, 0.0, 5.0])],
        box,
    )

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [
            sys.executable,
            "-m",
            "mimicbench.cli",
            "retarget",
            "--task",
            "lift-box",
            "--workers",
            "1",
            "--references.source",
            "given",
            *arguments,
        ]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=120, check=False)

    wrong = run("--method", "guess")
    assert (
        wrong.returncode == 2
        and "unknown retargeting method 'guess'" in wrong.stderr
        and not (tmp_path / "work" / "lift-box" / "retarget").exists()
    )
    none = run("--method", "copy-rotation", "--variant", "paper", "--json")  # the box is in the air, far from the hands
    assert none.returncode == 2 and "none of the 1 clips" in none.stderr and "K 1" in none.stderr
    (folder,) = (tmp_path / "work" / "lift-box" / "retarget").glob("copy-rotation-paper-given-*")
    assert (folder / f"{held.id}.npz").exists()


# --- side by side


def test_comparison_by_hand(tmp_path: Path) -> None:
    def result(method: str, wrist: float, pelvis: float) -> MethodResult:
        measures = {name: {"mean": 0.01, "worst": 0.02} for name in MEASURES}
        measures |= {"wrist_error": {"mean": wrist, "worst": wrist}, "pelvis_error": {"mean": pelvis, "worst": pelvis}}
        told = {"clips": 4, "fulfilled": 3, "kept": 2, "measures": measures}
        return MethodResult("sit-chair", method, "paper", told, 1234.6)

    found = Comparison(
        (result("copy-rotation", 0.3, 0.1), result("omnih2o", 0.2, 0.2), result("optimization", 0.1, 0.05))
    )
    assert found.ordering() == {
        "sit-chair": {"wrist": (True, True), "pelvis": (True, False), "position": (False, False), "k": (True, True)}
    }
    places = found.tables()[0]
    assert [row[4] for row in places.rows] == [30.0, 20.0, 10.0] and places.rows[0][-1] == 1235
    assert str(places.rows[0][2]).startswith("75.0 %") and [
        getattr(row[8], "percent", None) for row in places.rows
    ] == [66, 83, 92]
    page = write_comparison(tmp_path, found, {"sit-chair": ("A chair.", np.zeros((8, 8, 3), np.uint8))}).read_text()
    assert (
        "Copy rotation" in page
        and "://" not in page.replace("http://www.w3.org", "")
        and (tmp_path / "retargeting-sit-chair.jpg").exists()
    )
    assert "sit-chair" in (tmp_path / "retargeting-ordering.md").read_text()
    assert ("Wrists off", "cm", "1", "2") in measures_table("x", {"wrist_error": {"mean": 0.01, "worst": 0.02}}).rows


# --- mirror


def test_interaction_mirrored_in_mirrored_out() -> None:
    from mimicbench.retarget.methods.interaction import InteractionConfig, interact

    chair = make_chair(0, 0)
    other = replace(chair, box_pos=chair.box_pos * [1, -1, 1], box_quat=chair.box_quat * [1, -1, 1, -1])
    motion = replace(
        reach(UNIHSI, 10, chair),
        wrist_goal_w=np.zeros((0, 3)),
        object_pos_w=np.zeros((0, 3)),
        object_quat_w=np.zeros((0, 4)),
    )
    body = body_of(UNIHSI)
    quat = motion.local_quat.copy()
    quat[:, body.arms[0].root] = rot.from_rotvec(np.array([0.3, -0.5, 0.1]))
    quat[:, 0] = rot.from_yaw(np.linspace(0.1, 0.3, 10))
    motion = replace(motion, local_quat=quat)
    swap = {"left": "right", "right": "left"}

    def twin(name: str) -> str:
        side, _, rest = name.partition("_")
        return f"{swap[side]}_{rest}" if side in swap else name

    order = [UNIHSI.index(twin(name)) for name in UNIHSI.joint_names]
    mirrored = replace(
        motion, root_pos_w=motion.root_pos_w * [1, -1, 1], local_quat=motion.local_quat[:, order] * [1, -1, 1, -1]
    )
    config = InteractionConfig(iterations=60, tolerance=1e-8)
    straight, back = interact(Clip(motion, chair, H1), config), interact(Clip(mirrored, other, H1), config)
    columns = [H1.joint_names.index(twin(name)) for name in H1.joint_names]
    sign = np.where(H1.joint_axis[:, 1] != 0, 1.0, -1.0)
    assert np.abs(straight.joint_pos - back.joint_pos[:, columns] * sign).max() < 0.03
    assert np.abs(straight.root_pos_w - back.root_pos_w * [1, -1, 1]).max() < 2e-3
