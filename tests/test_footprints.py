"""A robot's feet on the way: still, flat, on the toes before they leave, and a pelvis that goes evenly over them."""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.objects.families.chair import make_chair
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.straight import clip_of_walk, straight_way
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.grounding import runs
from mimicbench.retarget.methods.feet import HEEL, ROLLING, footprints, on_toes
from mimicbench.retarget.methods.interaction import interact
from mimicbench.robots.registry import ROBOTS

H1 = ROBOTS.get("h1")
FPS = 50.0
SOLE = np.array([[-0.10, 0.0, -0.07], [0.20, 0.0, -0.07]])


def footprints_of(pitch: np.ndarray, bears: np.ndarray, x: np.ndarray):
    """Of a person's foot that goes along +x, pitched by angles [rad] about its toes."""
    level = np.column_stack([x, np.zeros_like(x), np.full_like(x, 0.07)])
    followed, human = on_toes(level, np.tile(rot.IDENTITY, (len(x), 1)), SOLE[-1], pitch)
    near_floor = 0.16 - followed[:, 2]
    place, turn, floor = footprints(FPS, bears, followed, human, SOLE, near_floor, lambda _, at, __: at)
    toes, heels = (place + rot.rotate(turn, point) for point in SOLE[::-1])
    down = -np.arcsin(rot.rotate(turn, np.array([1.0, 0.0, 0.0]))[:, 2])
    return toes, heels, down, floor


def a_step() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A second of standing, in whose last fifth the heel rises to 0.7 rad, half of one in the air, another of standing;
    pitches, when the foot bears, and where the ankle is.
    """
    bears = np.ones(125, bool)
    bears[50:75] = False
    pitch = np.concatenate([np.zeros(40), np.linspace(0.0, 0.7, 10), np.linspace(0.7, -0.2, 25), np.zeros(50)])
    x = np.concatenate([np.zeros(50), np.linspace(0.0, 0.5, 25), np.full(50, 0.5)])
    return pitch, bears, x


def test_a_foot_leaves_by_its_toes_and_arrives_flat():
    pitch, bears, x = a_step()
    toes, heels, down, floor = footprints_of(pitch, bears, x)
    np.testing.assert_array_equal(floor, bears)
    np.testing.assert_allclose(
        toes[:50], [[0.2, 0.0, 0.0]] * 50, atol=1e-9, err_msg="the toes stay while the heel rises"
    )
    np.testing.assert_allclose(heels[:40, 2], 0.0, atol=1e-9)
    assert down[49] == pytest.approx(HEEL, abs=0.01), "as far as the person's, but for how much"
    assert heels[49, 2] == pytest.approx(0.3 * np.sin(HEEL), abs=0.004)
    assert np.abs(np.diff(down)).max() < 0.12, "and goes on from there"
    assert down[55] > 0.3, "to point as the person's"
    np.testing.assert_allclose(down[75:], 0.0, atol=1e-9)
    np.testing.assert_allclose(heels[75:, 2], 0.0, atol=1e-9)
    assert abs(down[74]) < 0.05, "it arrives flat"


def test_the_heel_of_who_stays_does_not_rise():
    """Who is on the toes when the clip ends has nowhere to go, and a robot stands better flat."""
    pitch, bears, x = (part[:50] for part in a_step())
    _, heels, down, _ = footprints_of(pitch, bears, x)
    np.testing.assert_allclose(down, 0.0, atol=1e-9)
    np.testing.assert_allclose(heels[:, 2], 0.0, atol=1e-9)


@pytest.mark.parametrize("begin", [44, 47, 49])
def test_a_clip_that_begins_on_the_toes_has_them_where_they_were(begin: int):
    whole, cut = a_step(), [part[begin:] for part in a_step()]
    for found, expected in zip(footprints_of(*cut)[:2], footprints_of(*whole)[:2], strict=True):
        np.testing.assert_allclose(found[:20], expected[begin : begin + 20], atol=0.05)
    assert footprints_of(*cut)[3][: 50 - begin].all(), "they stand on the floor"


def test_who_begins_with_a_foot_in_the_air_has_it_as_if_it_had_left():
    pitch, bears, x = (part[50:] for part in a_step())
    _, _, down, floor = footprints_of(pitch, bears, x)
    assert not floor[:25].any()
    assert down[0] < HEEL + 0.7 / 6 + 1e-6, "the person's heel is 0.7 rad up"
    assert down[6] == pytest.approx(pitch[6], abs=0.05)


def test_the_heel_rises_in_time():
    """However early the person's does."""
    bears = np.ones(100, bool)
    bears[90:] = False
    pitch = np.full(100, 0.2)
    pitch[:30] = 0.0
    _, _, down, _ = footprints_of(pitch, bears, np.zeros(100))
    early = 90 - round(ROLLING * FPS)
    np.testing.assert_allclose(down[:early], 0.0, atol=1e-9)
    assert (np.diff(down[early:90]) >= -1e-9).all() and down[89] == pytest.approx(0.2, abs=0.01)


def test_a_foot_that_rests_toes_up_is_where_the_persons_is():
    """Half a second of a leg that swings onto a bed, then its heel on it: no foot is levelled that does not stand, and
    the leg comes down on the person's path.
    """
    rests = np.arange(60) >= 25
    human = np.tile(rot.from_rotvec(np.array([0.0, -np.pi / 2, 0.0])), (60, 1))
    followed = np.column_stack([np.ones(60), np.zeros(60), np.where(rests, 0.6, np.linspace(0.2, 0.6, 60))])
    place, turn, floor = footprints(FPS, rests, followed, human, SOLE, 0.16 - followed[:, 2], lambda _, at, __: at)
    assert not floor.any()
    np.testing.assert_allclose(place, followed, atol=1e-9)
    np.testing.assert_allclose(turn[rests], human[rests], atol=1e-9)


@pytest.mark.parametrize("speed", [0.45, 0.6, 0.75])
def test_a_robot_carries_its_pelvis_as_evenly_as_people_do(speed: float):
    """Its own feet flat until they leave, it went up and down by 3, 5, 6 cm in a step."""
    chair = make_chair(0, 0)
    far = replace(chair, box_pos=chair.box_pos + [50.0, 0.0, 0.0], hulls=())
    motion = clip_of_walk(unihsi_body(1.0), straight_way(unihsi_body(1.0), Gait(speed=speed), 4.0))
    robot = interact(Clip(motion, far, H1))
    middle = slice(round(1.5 * motion.fps), motion.frames - round(2.5 * motion.fps))
    heights = robot.root_pos_w[middle, 2]
    step = np.lib.stride_tricks.sliding_window_view(heights, round(0.6 * motion.fps))
    assert np.median(np.ptp(step, axis=-1)) < 0.035
    assert heights.mean() > 0.98
    assert robot.measures["step_skate"] < 0.02
    assert len(runs(motion.contacts[:, 0].astype(bool))) >= 3
