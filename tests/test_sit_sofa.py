"""Sitting down on sofas, and the styles of sitting that chairs share: supports that are touched, a drop, a back that
is leaned against.
"""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.families.sofa import make_sofa
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.handholds import armrest, beside_thigh, hanging
from mimicbench.references.actions.seats import lean_against, place_at, places, sit_free
from mimicbench.references.actions.sit_styles import ARM, HANGS, LAP, SEAT, THIGH, SitStyle, draw_manner
from mimicbench.references.actions.sitting import leaning, sinking
from mimicbench.references.actions.sitting_hands import arms_depth, tamer
from mimicbench.references.body.body import body_of, roam_body
from mimicbench.references.body.posing import Arms, Trunk
from mimicbench.references.checks.gait_measures import measure_gait
from mimicbench.references.checks.quality import check_clip, faults
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.references.synthesis.sit_sofa import make_sit_sofa

CLIPS = 24
PLAIN = SitStyle(1.06, 0.66, 1.8, 0.6, 0.05, 0.0, 0.0, 1.0)
START = np.array([1.6, 0.3]), 2.0


@pytest.fixture(scope="module")
def clips() -> list[tuple[HumanMotion, SceneObject]]:
    return [(synthesize("sit-sofa", i, make_sofa(i), 0), make_sofa(i)) for i in range(CLIPS)]


def block(size: tuple[float, float, float], at: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    return np.array(at), np.array(size) / 2


def sofa(arms: bool = True, back: bool = True) -> SceneObject:
    """A seat of 0.5 x 0.7 m at 0.42 m, arms of 15 cm that are 17 cm higher, and an upright back."""
    boxes = [block((0.5, 0.7, 0.42), (0.0, 0.0, 0.21))]
    boxes += [block((0.5, 0.15, 0.59), (0.0, side * 0.425, 0.295)) for side in (-1, 1)] * arms
    boxes += [block((0.1, 1.0, 0.90), (-0.3, 0.0, 0.45))] * back
    pos, half = np.array([box[0] for box in boxes]), np.array([box[1] for box in boxes])
    outline = np.array([[0.25, -0.35], [0.25, 0.35], [-0.25, 0.35], [-0.25, -0.35]])
    quat = np.tile([1.0, 0, 0, 0], (len(boxes), 1))
    return SceneObject(
        "sofa-by-hand", "sofa", "three-seater", pos, quat, half, np.full((len(boxes), 3), 0.5), 0.42, outline
    )


def sit(obj: SceneObject, **style: float) -> HumanMotion:
    return make_sit_sofa("clip", obj, *START, replace(PLAIN, **style))


def label(motion: HumanMotion, name: str) -> np.ndarray:
    return motion.contacts[:, motion.contact_names.index(name)]


def test_clips_pass_the_gate_and_sit(clips):
    for motion, obj in clips:
        measures = check_clip(motion, obj)
        assert faults(measures) == [], (motion.id, obj.kind, measures)
        above = motion.root_pos_w[:, 2] - obj.require_seat()
        sits = obj.contains_xy(motion.root_pos_w) & (above >= 0) & (above <= 0.27)  # K, for the pelvis of a human
        first = np.flatnonzero(sits)[0]
        assert sits[first:].all() and motion.frames - first > 0.3 * motion.fps
        assert motion.task == "sit-sofa" and motion.skeleton.name == "roam"


def test_clips_are_as_long_as_the_papers_and_end_at_rest(clips):
    durations = np.array([motion.duration for motion, _ in clips])
    assert durations.mean() == pytest.approx(12.1, abs=0.05) and np.abs(durations - 12.1).max() <= 0.1 + 1 / 30
    for motion, _ in clips:
        assert np.ptp(motion.root_pos_w[-10:], axis=0).max() < 0.012
        pos, _ = motion.forward_kinematics()
        assert 1e-5 < np.ptp(pos[-30:, body_of(motion.skeleton).head], axis=0).max() < 0.2  # breathes, and looks around


def test_people_of_all_sizes_take_several_places(clips):
    statures = [1.62 * motion.style["body_scale"] for motion, _ in clips]
    assert min(statures) > 1.55 and max(statures) < 1.88 and np.ptp(statures) > 0.15
    offsets = np.array([motion.root_pos_w[-1, 1] for motion, _ in clips])
    assert np.ptp(offsets) > 0.4
    for motion, obj in clips:
        right, left = obj.seat_polygon[:, 1].min(), obj.seat_polygon[:, 1].max()
        assert right + 0.24 < motion.root_pos_w[-1, 1] < left - 0.24


def test_most_clips_begin_in_motion(clips):
    speed = np.array([np.linalg.norm(motion.root_pos_w[1] - motion.root_pos_w[0]) * motion.fps for motion, _ in clips])
    assert (speed > 0.1).mean() > 0.4 and speed.max() < 1.2
    assert any(not motion.contacts[0, :2].all() for motion, _ in clips)


def test_places_by_hand():
    assert places(sofa()) == pytest.approx([0.0])
    wide = replace(sofa(), seat_polygon=sofa().seat_polygon * [1.0, 2.4])
    assert places(wide) == pytest.approx([-0.56, 0.0, 0.56])


def both(down: float, rest: float) -> dict[str, float]:
    return {"left_down": down, "right_down": down, "left_rest": rest, "right_rest": rest}


def wrists(motion: HumanMotion) -> np.ndarray:
    pos, _ = motion.forward_kinematics()
    return pos[:, [arm.end for arm in body_of(motion.skeleton).arms]]


def test_hands_rest_on_the_arms_of_the_seat():
    motion = sit(sofa(), **both(ARM, ARM))
    at = wrists(motion)
    assert motion.style["left_down"] == motion.style["right_rest"] == ARM
    for side, name in enumerate(("left_hand", "right_hand")):
        touching, seated = np.flatnonzero(label(motion, name)), np.flatnonzero(label(motion, "pelvis"))[0]
        assert touching[-1] == motion.frames - 1 and touching[0] < seated  # they bear before the seat does
        assert (np.diff(touching) == 1).all() and np.ptp(at[touching, side], axis=0).max() < 0.015
        assert np.abs(np.abs(at[-1, side, 1]) - 0.425) < 0.075 and np.sign(at[-1, side, 1]) == 1 - 2 * side
        assert 0.62 < at[-1, side, 2] < 0.66  # the palm on the arm's top at 0.59
    assert sofa().distance(at[-1]).min() > 0.03


def test_one_hand_takes_the_arm_and_goes_on_to_the_thigh():
    motion = sit(sofa(), left_down=ARM, left_rest=THIGH, right_down=THIGH, right_rest=THIGH)
    touching = np.flatnonzero(label(motion, "left_hand"))
    assert len(touching) > 12 and touching[-1] < motion.frames - 20 and not label(motion, "right_hand").any()
    assert np.abs(wrists(motion)[-1, :, 1]).max() < 0.25


def test_hands_go_one_after_the_other():
    together, after = (sit(sofa(), **both(ARM, LAP), left_late=late) for late in (0.0, 0.6))
    gone = [
        [np.flatnonzero(label(motion, name))[-1] for name in ("left_hand", "right_hand")]
        for motion in (together, after)
    ]
    assert gone[0][0] == gone[0][1] and 12 < gone[1][0] - gone[1][1] < 24


def test_an_arm_that_is_not_there_is_not_used():
    motion = sit(sofa(arms=False), **both(ARM, ARM))
    assert motion.style["left_down"] == THIGH and not label(motion, "left_hand").any()
    body, place = roam_body(1.06), place_at(sofa(), roam_body(1.06), 0.0)
    assert armrest(sofa(arms=False), body, place.pelvis, place.pelvis + [0, 0.15, 0.48], 0) is None
    wall = replace(sofa(), seat_polygon=sofa().seat_polygon * [1.0, 0.4])
    assert beside_thigh(wall, body, place.pelvis, 0) is None
    assert hanging(sofa(), body, place.pelvis + [0, 0.4, 0.40], 0) is None  # into the arm


def test_hands_rest_on_the_seat_and_in_the_lap():
    motion = sit(sofa(arms=False), **both(SEAT, SEAT), recline=-0.5, slump=0.4, left_along=0.6, right_along=0.4)
    at = wrists(motion)[-1]
    assert (np.abs(at[:, 1]) > 0.2).all() and at[:, 2] == pytest.approx(0.42 + 0.045, abs=0.012)
    assert label(motion, "left_hand")[-1] and label(motion, "right_hand")[-1]
    upright = sit(sofa(arms=False), **both(SEAT, SEAT))  # too far for such short arms
    assert upright.style["left_rest"] == THIGH and upright.style["left_down"] == SEAT
    motion = sit(sofa(), **both(HANGS, LAP))
    pos, _ = motion.forward_kinematics()
    at, knees = wrists(motion)[-1], pos[-1, [leg.middle for leg in body_of(motion.skeleton).legs]]
    assert (np.abs(at[:, 1]) < 0.09).all() and np.linalg.norm(at[0] - at[1]) < 0.16
    assert (at[:, 0] < knees[:, 0] - 0.1).all() and (at[:, 2] > knees[:, 2] - 0.05).all()


def test_hands_push_on_the_thighs_on_the_way_down():
    apart = []
    for down in (THIGH, HANGS):
        motion = sit(sofa(arms=False), **both(down, THIGH))
        body, (pos, _) = body_of(motion.skeleton), motion.forward_kinematics()
        middle = np.flatnonzero(label(motion, "pelvis"))[0] - 25
        knees, hips = pos[middle, [leg.middle for leg in body.legs]], pos[middle, [leg.root for leg in body.legs]]
        along = np.linspace(0, 1, 21)[:, None, None]
        apart.append(np.linalg.norm(wrists(motion)[middle] - (hips + along * (knees - hips)), axis=-1).min(0).max())
    assert apart[0] < 0.15 < 0.2 < apart[1]


def test_hips_sink_and_the_trunk_leans_as_real_people_do():
    u = np.linspace(-0.3, 1.5, 181)
    down, (lean, upright) = sinking(u), leaning(u)
    assert (np.diff(down) >= 0).all() and down[0] == 0 and down[-1] == pytest.approx(1.0)
    taken = u[np.argmax(down > 0.95)] - u[np.argmax(down > 0.05)]
    assert taken == pytest.approx(2 / 3, abs=0.03)
    farthest = int(np.argmax(lean - upright))
    assert down[farthest] == pytest.approx(0.35, abs=0.06)  # real people: as the pelvis has come a third of the way
    motion = sit(sofa(), lean=0.9, sit_duration=2.6)
    measured = measure_gait(motion)
    assert measured.sit_lean == pytest.approx(np.degrees(0.9), abs=3) and measured.sit_time == pytest.approx(
        1.75, abs=0.12
    )


def test_seated_poses_differ():
    """Joints of two clips on one object are far apart, also on a seat that leaves little room."""
    random, ends = np.random.default_rng(0), []
    for _ in range(14):
        style = replace(PLAIN, **draw_manner(random), seat_x=random.uniform(-0.1, 0.0))
        pos, _ = make_sit_sofa("clip", sofa(), *START, style).forward_kinematics()
        ends.append(pos[-1])
    apart = np.linalg.norm(np.array(ends)[:, None] - np.array(ends), axis=-1).mean(-1)
    assert apart[np.triu_indices(14, 1)].mean() > 0.10


def test_the_head_turns_to_the_seat_before_the_back_does():
    turned = []
    for look in (1.0, 0.0):
        motion = sit(sofa(), look=look)
        body, (_, quat) = body_of(motion.skeleton), motion.forward_kinematics()
        bears = np.flatnonzero(label(motion, "pelvis"))[0]
        away = rot.wrap_angle(rot.yaw_of(quat[:bears, body.head]) - rot.yaw_of(quat[:bears, 0]))
        turned.append(np.abs(away).max())
    assert turned[0] > 0.7 and turned[0] > turned[1] + 0.25


def test_who_drops_is_faster_at_the_end():
    speeds = []
    for drop in (0.0, 0.05):
        motion = sit(sofa(), drop=drop)
        height = motion.root_pos_w[:, 2]
        last = np.flatnonzero(height < height[-1] + 0.04)[0]
        speeds.append((height[last - 1] - height[last]) * motion.fps)
        assert height[-1] == pytest.approx(0.42 + roam_body(1.06).buttock - 0.01, abs=1e-6)
    assert speeds[1] > 1.15 * speeds[0]


def test_who_leans_back_bears_on_the_back():
    motion = sit(sofa(), against=1.0, lean_back=0.3, slump=0.15)
    body, (pos, quat) = body_of(motion.skeleton), motion.forward_kinematics()
    assert (
        motion.style["against"] == 1.0
        and label(motion, "back")[-1]
        and not label(motion, "back")[label(motion, "pelvis").argmax()]
    )
    assert motion.root_pos_w[-1, 0] < sit(sofa()).root_pos_w[-1, 0] - 0.02
    trunk = next(part for part in body.parts if part.role == "trunk")
    axis = pos[-1, trunk.joint] + rot.rotate(quat[-1, trunk.joint], np.linspace(trunk.start, trunk.end, 5))
    assert 0.0 < trunk.radius - sofa().distance(axis).min() < 0.03
    upright = sit(sofa(back=False), against=1.0, lean_back=0.3)
    assert upright.style["against"] == -1.0 and not label(upright, "back").any()
    assert lean_against(sofa(back=False), roam_body(1.06), place_at(sofa(), roam_body(1.06), 0.0), 0.3, 0.15) is None


def test_who_leans_on_nothing_keeps_off_the_back_and_on_the_seat():
    body = roam_body(1.06)
    place = place_at(sofa(), body, 0.0)
    free = sit_free(sofa(), body, place, 0.3, 0.4, 0.2)
    assert not free.bears and place.pelvis[0] - 0.3 <= free.pelvis[0] < place.pelvis[0] and 0 <= free.pitch <= 0.4
    assert sit_free(sofa(back=False), body, place, 0.3, 0.4, 0.2).pitch == 0.4
    assert sit_free(sofa(back=False), body, place, 0.5, 0.0, 0.1).pelvis[0] >= -0.25 + 0.10 - 1e-9
    deeper = place_at(sofa(), body, 0.0, -0.08)
    assert place.pelvis[0] - 0.08 - 1e-9 <= deeper.pelvis[0] <= place.pelvis[0]


def test_a_clip_is_remade_alone_from_its_id(clips):
    motion, obj = clips[5]
    again = synthesize("sit-sofa", 5, obj, 0)
    assert again.local_quat.tobytes() == motion.local_quat.tobytes() and again.style == motion.style
    with pytest.raises(BadObject, match="no seat"):
        synthesize("sit-sofa", 0, SceneObject.from_dict({**obj.to_dict(), "seat_height": None}), 0)


def test_arms_that_would_go_through_the_object_take_a_plainer_way():
    style = replace(PLAIN, left_down=ARM, elbows=1.5)
    ways = list(tamer(style))
    assert ways[0] == style and ways[1].elbows < 0.5 and ways[2].left_down == THIGH and ways[3].right_rest == THIGH
    body, arms = roam_body(1.0), Arms(np.tile(rot.IDENTITY, (1, 2, 1)), np.tile(rot.IDENTITY, (1, 2, 1)))
    level = np.tile(rot.IDENTITY, (1, 1))
    for height, deep in ((1.4, False), (0.4, True)):  # hands at the seat's side, or in it
        trunk = Trunk(np.array([[0.0, 0.0, height]]), level, level, level)
        assert (arms_depth(sofa(), body, trunk, arms, np.array([0])) > 0.0) == deep
