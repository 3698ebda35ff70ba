"""Retargeting: the table, the Jacobians, the banded solver, and what comes out of it."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, UnknownName
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.skeleton import Skeleton
from mimicbench.objects.families.chair import make_chair
from mimicbench.references.body.skeletons import UNIHSI
from mimicbench.retarget.baselines.adam import adam
from mimicbench.retarget.baselines.speed import frames_per_second
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.grounding import ground, sole_heights, stance
from mimicbench.retarget.kinematics import Jacobian, Links, Pose, tree_of
from mimicbench.retarget.mapping import Bound, bind, find_mapping
from mimicbench.retarget.methods import optimization as opt
from mimicbench.retarget.methods.copy_rotation import copy_rotations
from mimicbench.retarget.methods.optimization import PAPER, OptimizationConfig, optimize
from mimicbench.retarget.registry import METHODS
from mimicbench.retarget.solver import _solve_with, move, solve
from mimicbench.robots.registry import ROBOTS

H1 = ROBOTS.get("h1")
UNIHSI_H1 = find_mapping("unihsi", H1)
TREE = tree_of(H1)
LIMITS = H1.joint_range
SIDES = {"left": "right", "right": "left"}
CLIPS = Path(__file__).parents[1].parent / "shared" / "data" / "unihsi" / "motion_clips"


def turn(axis: str, angle: np.ndarray | float) -> np.ndarray:
    return rot.from_rotvec(np.asarray(angle)[..., None] * np.eye(3)["xyz".index(axis)])


def walk(frames: int = 24, size: float = 1.0, skeleton: Skeleton = UNIHSI) -> HumanMotion:
    """Steps on the spot, arms swinging, a slow turn: every mapped joint moves."""
    t = np.arange(frames) / 30.0
    quat = np.tile(rot.IDENTITY, (frames, 15, 1))
    phase = 2 * np.pi * 0.8 * t
    quat[:, 0] = rot.multiply(turn("z", 0.4 + 0.3 * t), turn("x", 0.03 * np.sin(phase)))
    quat[:, 1] = turn("y", 0.1 + 0.1 * np.sin(phase))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        lift = np.maximum(0.0, sign * np.sin(phase))
        joints = {
            name: skeleton.index(f"{side}_{name}") for name in ("thigh", "shin", "foot", "upper_arm", "lower_arm")
        }
        quat[:, joints["thigh"]] = turn("y", -0.25 - 0.5 * lift)
        quat[:, joints["shin"]] = turn("y", 0.5 + 0.9 * lift)
        quat[:, joints["foot"]] = turn("y", -0.25 - 0.4 * lift)
        quat[:, joints["upper_arm"]] = rot.multiply(turn("y", -0.3 * sign * np.sin(phase)), turn("x", 0.15 * sign))
        quat[:, joints["lower_arm"]] = turn("y", -0.5 - 0.2 * lift)
    height = size * (0.05 + 0.40987 * np.cos(0.25) + 0.421546 * np.cos(0.25))
    root = np.stack([0.3 + 0.1 * t, -0.2 + 0.02 * np.sin(phase), np.full(frames, height)], -1)
    return HumanMotion("walk-0", "sit-chair", skeleton.scaled(size), 30.0, root, quat, "chair-1")


def mirrored_human(motion: HumanMotion) -> HumanMotion:
    order = [motion.skeleton.index(_other_side(name)) for name in motion.skeleton.joint_names]
    return replace(
        motion, root_pos_w=motion.root_pos_w * [1, -1, 1], local_quat=motion.local_quat[:, order] * [1, -1, 1, -1]
    )


def mirrored_robot(motion: RobotMotion) -> RobotMotion:
    order = [motion.joint_names.index(_other_side(name)) for name in motion.joint_names]
    sign = np.where(H1.joint_axis[:, 1] != 0, 1.0, -1.0)  # pitch stays, roll and yaw change sign
    root = motion.root_pos_w * [1, -1, 1]
    return replace(
        motion,
        root_pos_w=root,
        root_quat_w=motion.root_quat_w * [1, -1, 1, -1],
        joint_pos=motion.joint_pos[:, order] * sign,
    )


def _other_side(name: str) -> str:
    side, _, rest = name.partition("_")
    return f"{SIDES[side]}_{rest}" if side in SIDES else name


def random_pose(random: np.random.Generator, frames: int = 3) -> Pose:
    quat = rot.normalize(random.normal(size=(frames, 4)))
    return Pose(
        random.normal(size=(frames, 3)), quat, random.uniform(LIMITS[:, 0] + 0.01, LIMITS[:, 1] - 0.01, (frames, 19))
    )


def retargeted(motion: HumanMotion, config: OptimizationConfig | None = None) -> RobotMotion:
    return optimize(Clip(motion, make_chair(0, 0), H1), config)


def example(config: OptimizationConfig, frames: int = 8) -> tuple[opt.Problem, Pose]:
    motion = walk(frames)
    bound = bind(UNIHSI_H1, motion.skeleton, H1, config.preset)
    pos, quat = motion.forward_kinematics()
    problem = opt.make_problem(bound, TREE, LIMITS, pos, quat, motion.fps, config, by_hand=True)
    return problem, copy_rotations(bound, TREE, LIMITS, pos, quat)


# --- the table


def test_arms_down_points_forearms_down() -> None:
    joints = np.array([H1.arms_down.get(name, 0.0) for name in H1.joint_names])
    pos, quat = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, joints)
    for side in SIDES:
        elbow = H1.link_names.index(f"{side}_elbow_link")
        forearm = H1.keypoint_pos(f"{side}_wrist", pos, quat) - pos[elbow]
        assert forearm[2] < -0.27 and abs(forearm[1]) < 1e-6


def test_shifts_lay_surface_on_surface_for_every_size() -> None:
    for size in (0.9, 1.0, 1.1):
        bound = bind(UNIHSI_H1, UNIHSI.scaled(size), H1)
        by_link = {H1.link_names[link]: shift for link, shift in zip(bound.links, bound.shifts, strict=True)}
        assert by_link["left_ankle_link"][2] == pytest.approx(0.07 - 0.05 * size)
        assert by_link["pelvis"][2] == pytest.approx(0.245 - 0.09 * size)


def test_errors_name_what_is_missing() -> None:
    motion = walk(4)
    with pytest.raises(UnknownName, match="for h1 .*unihsi"):
        retargeted(replace(motion, skeleton=replace(motion.skeleton, name="centaur")))
    with pytest.raises(UnknownName, match="for h1 .*unihsi"):
        find_mapping("r2d2", H1)
    names = tuple("left_fin" if name == "left_foot" else name for name in UNIHSI.joint_names)
    with pytest.raises(BadMotion, match="no joint 'left_foot'"):
        bind(UNIHSI_H1, replace(UNIHSI, joint_names=names), H1)
    links = tuple(replace(link, name="tail") if link.name == "torso_link" else link for link in H1.links)
    with pytest.raises(BadMotion, match="no link 'torso_link'"):
        bind(UNIHSI_H1, UNIHSI, replace(H1, links=links))


# --- kinematics


def test_tree_places_links_as_the_robot_does() -> None:
    pose = random_pose(np.random.default_rng(0))
    links = TREE.place(pose)
    pos, quat = H1.forward_kinematics(*pose)
    assert np.allclose(links.pos, pos, atol=1e-12)
    assert np.abs(rot.angle_between(links.quat, quat)).max() < 1e-7


def test_jacobians_match_finite_differences() -> None:
    random = np.random.default_rng(1)
    pose, points, turns = random_pose(random), np.array([0, 5, 15, 19]), np.array([0, 3, 14, 10])
    offsets = random.normal(size=(4, 3)) * 0.2

    def place(at: Pose) -> tuple[np.ndarray, np.ndarray, Links]:
        links = TREE.place(at)
        return links.pos[:, points] + rot.rotate(links.quat[:, points], offsets), links.quat[:, turns], links

    at, quat, links = place(pose)
    found = Jacobian(TREE, points, turns, 3).fill(links, at)
    h = 1e-6
    for v in range(25):
        step = np.zeros((3, 25))
        step[:, v] = h
        moved, turned, _ = place(move(pose, step, LIMITS))
        expected = np.concatenate(
            [
                ((moved - at) / h).reshape(3, -1),
                (rot.to_rotvec(rot.multiply(turned, rot.conjugate(quat))) / h).reshape(3, -1),
            ],
            1,
        )
        assert np.allclose(found[:, :, v], expected, atol=2e-5)


@pytest.mark.parametrize("config", [OptimizationConfig(hand=2.0), replace(PAPER, hand=0.0)])
def test_gradient_is_that_of_the_loss(config: OptimizationConfig) -> None:
    problem, pose = example(config, 5)
    random = np.random.default_rng(2)
    away = random.normal(size=(5, 25)) * 0.05  # some soles go under the floor
    pose = move(pose, away, LIMITS * 0.9)
    gradient = problem.model(pose, TREE.place(pose)).gradient
    for _ in range(5):
        direction = random.normal(size=(5, 25))
        values = []
        for h in (1e-6, -1e-6):
            moved = move(pose, h * direction, np.tile([-9.0, 9.0], (19, 1)))
            values.append(problem.loss(moved, TREE.place(moved)))
        assert (values[0] - values[1]) / 2e-6 == pytest.approx((gradient * direction).sum(), rel=1e-4, abs=1e-7)


def test_banded_solution_with_held_variables_is_the_dense_one() -> None:
    random = np.random.default_rng(3)
    size, width = 40, 7
    band = random.normal(size=(width, size)) * 0.3
    band[0] = 6.0 + random.random(size)
    dense = np.zeros((size, size))
    for k in range(width):
        dense += np.diag(band[k, : size - k], -k) + (np.diag(band[k, : size - k], k) if k else 0)
    right, values, held = random.normal(size=size), random.normal(size=size), random.random(size) < 0.3
    found = _solve_with(band, right, held, values)
    free = ~held
    expected = values.copy()
    expected[free] = np.linalg.solve(dense[np.ix_(free, free)], right[free] - dense[np.ix_(free, held)] @ values[held])
    assert np.allclose(found, expected)


# --- the optimum


def test_recovers_a_motion_that_the_robot_made() -> None:
    t = np.linspace(0, 1, 20)[:, None]
    middle = LIMITS.mean(1)
    joints = middle + 0.4 * np.sin(3 * t + np.arange(19)) * (LIMITS[:, 1] - middle)
    truth = Pose(np.hstack([t, 0.1 * t, 1.0 + 0 * t]), rot.from_rotvec(np.hstack([0.1 * t, 0.2 * t, t])), joints)
    links = TREE.place(truth)
    each, same = np.arange(20), np.tile(rot.IDENTITY, (20, 1))
    none, one = np.zeros((0, 3)), np.ones(20)
    bound = Bound(each, each, np.zeros((20, 3)), each, one, one, each, each, same, (), same[:0], (), (), (), none)
    problem = opt.make_problem(bound, TREE, LIMITS, links.pos, links.quat, 30.0, replace(PAPER, acceleration=1e-9))
    found, losses = solve(problem, truth._replace(joints=np.tile(middle, (20, 1))), 60, 1e-9)
    assert np.abs(found.joints - truth.joints).max() < 1e-3
    assert np.abs(found.root_pos - truth.root_pos).max() < 1e-4
    assert (np.diff(losses) < 0).all()


def test_at_least_as_good_as_the_papers_adam() -> None:
    problem, start = example(PAPER, 6)
    problem = replace(problem, softness=1e-3, acceleration_softness=0.1 * problem.acceleration_softness)
    ours, _ = solve(problem, start, 100, 1e-7)
    adams, _ = adam(problem, start, 300, falling=True)  # kinder to Adam than the constant rate of the appendix
    assert problem.loss(ours, TREE.place(ours), softened=False) <= problem.loss(
        adams, TREE.place(adams), softened=False
    )


def test_mirrored_in_mirrored_out() -> None:
    config = OptimizationConfig(tolerance=1e-7, iterations=60)
    motion = walk(12)
    straight, other = retargeted(motion, config), mirrored_robot(retargeted(mirrored_human(motion), config))
    assert np.abs(straight.joint_pos - other.joint_pos).max() < 0.02
    assert np.abs(straight.root_pos_w - other.root_pos_w).max() < 1e-3
    assert np.abs(rot.angle_between(straight.root_quat_w, other.root_quat_w)).max() < 5e-3


@settings(max_examples=12, deadline=None)
@given(
    st.integers(0, 10**6),
    st.integers(2, 6),
    st.floats(0.1, 3.0),
    st.sampled_from([OptimizationConfig(iterations=6), replace(PAPER, iterations=6)]),
)
def test_limits_always_hold(seed: int, frames: int, wildness: float, config: OptimizationConfig) -> None:
    random = np.random.default_rng(seed)
    motion = walk(frames)
    motion = replace(
        motion,
        local_quat=rot.multiply(motion.local_quat, rot.from_rotvec(random.normal(size=(frames, 15, 3)) * wildness)),
    )
    result = retargeted(motion, config)
    stored = result.joint_pos.astype(np.float32).astype(float)
    assert (stored >= LIMITS[:, 0]).all() and (stored <= LIMITS[:, 1]).all()
    assert result.measures["limit_violation"] == 0.0
    assert all(np.isfinite(value) for value in result.measures.values())


def test_walking_feet_stay_in_their_places() -> None:
    for size in (0.95, 1.05):
        measures = retargeted(walk(40, size)).measures
        assert measures["ankle_error"] < 0.01
        assert measures["sole_depth"] < 0.01
        assert measures["sole_tilt"] < 0.12
        assert measures["velocity_ratio"] < 1.0


def test_carries_everything_over_and_is_deterministic(tmp_path: Path) -> None:
    motion = replace(
        walk(5), contact_names=("left_foot", "right_foot"), contacts=np.ones((5, 2), bool), style={"speed": 0.5}
    )
    result = retargeted(motion)
    assert (result.id, result.task, result.object_id, result.reference_id, result.fps) == (
        motion.id,
        motion.task,
        motion.object_id,
        motion.id,
        motion.fps,
    )
    assert (
        result.style == {"speed": 0.5}
        and result.contact_names == motion.contact_names
        and (result.contacts == motion.contacts).all()
    )
    assert result.robot == "h1" and result.success
    result.save(tmp_path / "clip.npz")
    assert dict(RobotMotion.load(tmp_path / "clip.npz", "h1").measures) == pytest.approx(dict(result.measures))
    again = pickle.loads(pickle.dumps(optimize))(
        Clip(motion, make_chair(0, 0), pickle.loads(pickle.dumps(H1)))
    )  # as it travels to another process
    assert (again.joint_pos == result.joint_pos).all() and (again.root_pos_w == result.root_pos_w).all()


# --- standing on the floor


def test_ground_puts_the_stance_sole_on_the_floor() -> None:
    motion = walk(6)
    bound = bind(UNIHSI_H1, motion.skeleton, H1)
    pose = Pose(np.tile([0.0, 0.0, 1.0], (6, 1)), np.tile(rot.IDENTITY, (6, 1)), np.zeros((6, 19)))
    # straight legs: the ankle is 0.9742 m below the pelvis, the sole 0.07 m below the ankle
    assert sole_heights(TREE.place(pose), bound) == pytest.approx(1.0 - 1.0442 * np.ones((6, 2)))
    assert ground(TREE.place(pose), bound, np.ones((6, 2), bool)) == pytest.approx(0.0442)
    assert ground(TREE.place(pose), bound, np.zeros((6, 2), bool)) == pytest.approx(0.0442)
    high = pose._replace(root_pos=pose.root_pos + [0, 0, 1.0])
    assert (
        ground(TREE.place(high), bound, np.zeros((6, 2), bool)) == 0.0
    )  # lies on something: nothing tells where the floor is


def test_stance_comes_from_labels_or_from_low_slow_ankles() -> None:
    motion = walk(4)
    bound = bind(UNIHSI_H1, motion.skeleton, H1)
    ankles = np.zeros((4, 2, 3))
    ankles[:, 0, 2], ankles[:, 1, 2] = 0.05, 0.3
    assert (stance(motion, bound, ankles) == [True, False]).all()
    labels = np.array([[True, False, True]] * 4)
    labeled = replace(motion, contact_names=("right_foot", "left_foot", "pelvis"), contacts=labels)
    assert (stance(labeled, bound, ankles) == [False, True]).all()


def test_frames_per_second_counts() -> None:
    assert frames_per_second([Clip(walk(30), make_chair(0, 0), H1)], METHODS.get("copy-rotation")) > 0


@pytest.mark.skipif(not CLIPS.is_dir(), reason="the recorded UniHSI clips are not here")
def test_real_people_become_robots() -> None:
    from mimicbench.references.importers.unihsi import import_skeleton_motion
    from mimicbench.references.recordings.real_clips import sitting_clips

    (motion, obj), *_ = sitting_clips(import_skeleton_motion(CLIPS / "armchair.npy"), "sit-chair")
    result = optimize(Clip(motion, obj, H1))
    assert result.measures["limit_violation"] == 0.0
    assert result.measures["skate"] < result.measures["human_skate"] + 0.03
    assert result.measures["velocity_ratio"] < 1.0
    assert 0.18 < result.root_pos_w[-10:, 2].mean() - obj.require_seat() < 0.27
