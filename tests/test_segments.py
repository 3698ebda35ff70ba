"""Which parts of a recording are a task, and which only look like it, on hand-made tracks of pelvis, head and limbs."""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.objects.registry import FAMILIES
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.recordings.cutting import HELD, settled
from mimicbench.references.recordings.handling import find_clasps, stood_up
from mimicbench.references.recordings.segments import find_lyings, find_sittings
from mimicbench.references.synthesis.registry import synthesize

FPS = 30
BODY = unihsi_body()


def person(pelvis, head, feet):
    """(T, 15, 3) of whom only these places count: pelvis (T, 3), and head and feet seen from it (T, 3) [m]."""
    pos = np.repeat(pelvis[:, None], 15, 1)
    pos[:, BODY.head] += head
    for leg in BODY.legs:
        pos[:, leg.end] += feet
    return pos


def walk_then(low, stays, seconds=4.0):
    """Pelvis (T, 3) of who walks up at 0.5 m/s, goes down to a height within a second, and stays; and how much of the
    way down is done (T,).
    """
    time = np.arange(round((seconds + 1.0 + stays) * FPS)) / FPS
    down = np.clip(time - seconds, 0, 1)
    down = down**2 * (3 - 2 * down)
    x = np.maximum(seconds - time, 0) * 0.5
    return np.stack([x, 0 * x, 0.88 + down * (low - 0.88)], -1), down


def along(angle, length, sign=1.0):
    """(T, 3) [m] forward of the vertical by angle (T,) [rad]."""
    return length * np.stack([sign * -np.sin(angle), 0 * angle, np.cos(angle)], -1)


@pytest.mark.parametrize("stays", [5.0, 55.0, 300.0])
def test_who_sits_for_long_sits(stays):
    pelvis, down = walk_then(0.5, stays)
    pos = person(pelvis, along(0 * down, 0.6), np.array([0.0, 0, -0.8]))
    [sitting] = find_sittings(BODY.skeleton, pos, FPS)
    assert sitting.landing == pytest.approx(4.85 * FPS, abs=5) and sitting.start < 3 * FPS


def test_what_a_seated_person_does_later_does_not_count():
    """The pelvis is on the seat for two seconds, then for long on the floor before it."""
    pelvis, down = walk_then(0.5, 40.0)
    pelvis[8 * FPS :, 2] = 0.30
    pos = person(pelvis, along(0 * down, 0.6), np.array([0.0, 0, -0.4]))
    assert len(find_sittings(BODY.skeleton, pos, FPS)) == 1


def test_a_squat_is_no_lying_down():
    pelvis, down = walk_then(0.35, 5.0)
    head = along(np.radians(75) * down, 0.6)
    squat = person(pelvis, head, np.array([-0.1, 0.0, -0.3]))
    assert not find_lyings(BODY.skeleton, squat, FPS), "the feet are below, not beyond the pelvis"
    feet = np.stack([0.7 * down, 0 * down, -0.8 * (1 - down)], -1)
    [lying] = find_lyings(BODY.skeleton, person(pelvis, head, feet), FPS)
    assert lying.landing < 5.2 * FPS


def test_who_lies_for_long_lies():
    pelvis, down = walk_then(0.45, 60.0)
    feet = np.stack([0.7 * down, 0 * down, -0.8 * (1 - down)], -1)
    assert len(find_lyings(BODY.skeleton, person(pelvis, along(np.radians(85) * down, 0.6), feet), FPS)) == 1


def test_a_jump_is_no_lift():
    time = np.arange(4 * FPS) / FPS
    rise = np.clip((time - 2.0) / 0.6, 0, 1)
    height = 0.5 + 0.5 * rise**2 * (3 - 2 * rise)
    wrists = np.stack([np.stack([0.3 + 0 * time, y + 0 * time, height], -1) for y in (0.2, -0.2)], 1)
    ankles = np.stack([np.stack([0 * time, y + 0 * time, 0.08 + 0 * time], -1) for y in (0.1, -0.1)], 1)
    [lift] = find_clasps(wrists, ankles, FPS)
    assert lift.end is not None and 2.2 * FPS < lift.end < 2.6 * FPS
    flight = np.clip(1 - np.abs(time - 2.75) / 0.25, 0, 1)
    assert not find_clasps(wrists, ankles + flight[:, None, None] * np.array([0, 0, 0.3]), FPS)
    step = ankles.copy()
    step[:, 0, 2] += 0.2 * flight
    assert len(find_clasps(wrists, step, FPS)) == 1, "who steps back with a box is on the floor"


def test_a_lift_goes_on_until_the_person_stands():
    time = np.arange(4 * FPS) / FPS
    zero = np.zeros_like(time)
    lifted = round(1.4 * FPS)

    def end(height, lean=zero, foot=zero):
        """When a lift ends, by heights of the pelvis (T,) [m], leans of the trunk (T,) [rad] and how far a foot is off
        the floor (T,) [m].
        """
        pelvis = np.stack([zero, zero, height], -1)
        head = pelvis + 0.6 * np.stack([np.sin(lean), zero, np.cos(lean)], -1)
        ankles = 0.08 + np.stack([np.stack([zero, zero, off], -1) for off in (zero, foot)], 1)
        return stood_up(pelvis, head, ankles, lifted, FPS)

    rising = 0.7 + 0.35 * np.clip((time - 1.0) / 1.0, 0, 1)
    assert end(rising) / FPS == pytest.approx(2.0, abs=0.1)
    assert end(zero + 1.0) == lifted, "who stands already is not waited for"
    assert end(0.3 * time) / FPS == pytest.approx(2.9, abs=0.1), "nobody rises for ever"
    straightens = np.radians(np.clip(80 - 60 * (time - 1.0), 0, 80))
    assert end(zero + 1.0, straightens) / FPS == pytest.approx(2.0, abs=0.1), "20 degrees"
    steps = 0.1 * ((time > 1.3) & (time < 2.3))
    assert end(zero + 1.0, foot=steps) / FPS == pytest.approx(2.3, abs=0.1), "who is in mid-step cannot hold a pose"
    lifted = len(time)
    assert end(0.3 * time) == len(time)


def test_what_is_held_comes_to_rest_with_who_holds_it():
    motion = synthesize("lift-box", 1, FAMILIES.get("box").make(1, 0), 0)
    lifted = int(np.argmax(motion.object_pos_w[:, 2] > 0.2))
    parts = {n: getattr(motion, n)[:lifted] for n in ("root_pos_w", "local_quat", "object_pos_w", "object_quat_w")}
    rising = replace(motion, contact_names=(), contacts=motion.contacts[:0, :0], **parts)
    rest = settled(rising)
    held = slice(-round(HELD * motion.fps), None)
    for before, after in ((rising.object_pos_w, rest.object_pos_w), (rising.root_pos_w, rest.root_pos_w)):
        assert after[:10] == pytest.approx(before[:10])
        assert after[held] == pytest.approx(np.broadcast_to(before[-1], after[held].shape), abs=1e-9)
    assert np.abs(np.linalg.norm(rest.object_quat_w, axis=-1) - 1).max() < 1e-9


@pytest.mark.parametrize("frames", range(30, 60))
def test_who_comes_to_rest_never_stands_still_before(frames):
    """At one speed until the ending, then ever slower: nowhere faster, and nowhere at rest before the end."""
    motion = synthesize("lift-box", 1, FAMILIES.get("box").make(1, 0), 0)
    place = np.arange(frames)[:, None] / FPS * np.array([1.0, 0.0, 0.0])
    still = replace(
        motion, contact_names=(), contacts=motion.contacts[:0, :0], root_pos_w=place,
        local_quat=motion.local_quat[:frames], object_pos_w=place, object_quat_w=motion.object_quat_w[:frames],
    )  # fmt: skip
    speed = np.diff(settled(still).root_pos_w[:, 0])[: -round(HELD * FPS)] * FPS
    assert speed.max() < 1.001 and (np.diff(speed)[:-1] < 0.05).all() and speed[:-1].min() > 0.02
