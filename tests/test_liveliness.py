"""Who rests goes on moving, and what bears stays where it is."""

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.body import Body, core4d_body, roam_body, unihsi_body
from mimicbench.references.body.liveliness import Rest, enliven, unrest
from mimicbench.references.body.posing import Legs, Trunk, pose, reach

FPS, FRAMES, BEGINS = 30.0, 400, 100
BODIES = [unihsi_body(1.05), roam_body(1.05), core4d_body(0.95)]
Pose = tuple[np.ndarray, np.ndarray]


def seated(body: Body, height: float = 0.55) -> Pose:
    """Somebody who does not move at all: the pelvis at some share of its standing height, hands over the knees."""

    def still(values: list[float] | np.ndarray) -> np.ndarray:
        return np.tile(values, (FRAMES, *[1] * np.ndim(values)))

    pelvis = np.array([0.0, 0.0, height * body.standing_height])
    ahead = 0.45 * body.size if height < 0.8 else 0.0
    sides = np.array([1.0, -1.0])[:, None] * [0.0, 1.0, 0.0]
    ankles = 0.11 * body.size * sides + [ahead, 0.0, body.sole]
    trunk = Trunk(still(pelvis), still(rot.IDENTITY), still(rot.IDENTITY), still(rot.IDENTITY))
    legs = Legs(still(ankles), still(np.tile(rot.IDENTITY, (2, 1))), still(np.array([[0.0, 1.0, 0.0]] * 2)))
    wrists = pelvis + [0.28 * body.size, 0.0, 0.12] + 0.14 * sides
    return still(pelvis), pose(body, trunk, legs, reach(body, trunk, still(wrists), still(np.array([[0.0, 1, 0]] * 2))))


def clock() -> np.ndarray:
    return (np.arange(FRAMES) - BEGINS) / FPS


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.skeleton.name)
@pytest.mark.parametrize("height", [0.55, 0.985])
def test_feet_and_held_hands_stay_exactly_where_they_are(body: Body, height: float):
    root, quat = seated(body, height)
    before, turns = forward_kinematics(body.skeleton, root, quat)
    pos, world = forward_kinematics(body.skeleton, *enliven(body, root, quat, Rest(clock(), (1.0, 1.0)), 7))
    feet, hands = [leg.end for leg in body.legs], [arm.end for arm in body.arms]
    assert np.abs(pos[:, feet] - before[:, feet]).max() < 1e-9
    assert rot.angle_between(world[:, feet], turns[:, feet]).max() < 1e-6
    assert np.abs(pos[:, hands] - before[:, hands]).max() < 1e-9
    assert rot.angle_between(world[:, hands], turns[:, hands]).max() < 1e-6
    assert (pos[: BEGINS + 1] == before[: BEGINS + 1]).all()


@pytest.mark.parametrize("body", BODIES, ids=lambda body: body.skeleton.name)
def test_nobody_freezes_and_nobody_hurries(body: Body):
    root, quat = seated(body)
    for habits in range(1, 9):
        made = enliven(body, root, quat, Rest(clock()), habits)
        pos, _ = forward_kinematics(body.skeleton, *made)
        speed = np.linalg.norm(np.diff(pos[BEGINS + 45 :], axis=0), axis=-1) * FPS
        seconds = speed[:, [body.head, *(arm.end for arm in body.arms)]][:240].reshape(8, 30, 3)
        assert seconds.max(1).min() > 1e-3  # in no second is the head or a hand still [m/s]
        assert 0.003 < np.median(speed[:, body.head]) < 0.08 and speed.max() < 0.6
        assert np.abs(np.diff(pos, 2, axis=0)).max() * FPS < 0.1  # nor does anything begin suddenly [m/s]
        assert np.ptp(pos[:, 0], axis=0).max() < 0.03 and np.linalg.norm(pos - pos[:1], axis=-1).max() < 0.25


def test_who_lies_breathes_and_looks_but_keeps_pelvis_and_legs():
    body = roam_body(1.0)
    root, quat = seated(body)
    made, turned = enliven(body, root, quat, Rest(clock(), trunk=0.0, gaze=0.5), 3)
    legs = [joint for leg in body.legs for joint in leg]
    assert (made == root).all() and np.abs(turned[:, [0, *legs]] - quat[:, [0, *legs]]).max() < 1e-12
    assert rot.angle_between(turned[-1, body.head], quat[-1, body.head]) > 1e-4
    breath = rot.to_rotvec(turned[:, body.spine[0]])[:, 1]
    assert 0.002 < np.ptp(breath) < 0.02 and len(np.flatnonzero(np.diff(np.sign(np.diff(breath))))) >= 3


def test_a_hand_settles_along_the_thigh_and_is_lifted_on_the_way():
    body = unihsi_body()
    root, quat = seated(body)
    settle = np.array([[0.05, 0.0, 0.0], [0.0, 0.0, 0.0]])
    before, _ = forward_kinematics(body.skeleton, root, quat)
    pos, _ = forward_kinematics(
        body.skeleton, *enliven(body, root, quat, Rest(clock(), (1.0, 1.0), settle_w=settle), 5)
    )
    moved = (pos - before)[:, [arm.end for arm in body.arms]]
    assert 0.01 < np.abs(moved[:, 0, 0]).max() <= 0.05 and np.abs(moved[:, 1]).max() < 1e-9
    assert 0.002 < moved[:, 0, 2].max() <= 0.011 and moved[:, 0, 2].min() > -1e-9 and abs(moved[-1, 0, 1]) < 1e-9


def test_the_same_number_gives_the_same_habits_and_its_negative_the_mirror_image():
    body = unihsi_body()
    root, quat = seated(body)
    first, again, other, mirrored = (enliven(body, root, quat, Rest(clock()), habits) for habits in (4, 4, 5, -4))
    assert first[1].tobytes() == again[1].tobytes() and np.abs(first[1] - other[1]).max() > 0.01
    pos, image = (forward_kinematics(body.skeleton, *made)[0] for made in (first, mirrored))
    left, right = ([limb.end for limb in pair] for pair in zip(body.arms, body.legs, strict=True))
    assert image[:, right] * [1.0, -1.0, 1.0] == pytest.approx(pos[:, left], abs=1e-9)
    assert image[:, body.head] * [1.0, -1.0, 1.0] == pytest.approx(pos[:, body.head], abs=1e-9)


def test_nothing_is_added_before_rest():
    body = unihsi_body()
    root, quat = seated(body)
    made = enliven(body, root, quat, Rest(np.full(FRAMES, -1.0)), 1)
    assert made[0] is root and made[1] is quat


def test_small_motions_go_on_in_whatever_somebody_does():
    size = np.array([0.01, 0.02, 0.03])
    first, mirrored = unrest(9, clock(), size), unrest(-9, clock(), size)
    assert first == pytest.approx(mirrored * [-1.0, 1.0, -1.0]) and (unrest(9, clock(), size) == first).all()
    assert (np.abs(first) <= 3 * size).all() and (first.std(0) > size).all()
