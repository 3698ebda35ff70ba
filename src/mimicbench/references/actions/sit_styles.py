"""The choices of somebody who sits down, told with every clip."""

from dataclasses import dataclass, replace

import numpy as np

HANGS, THIGH, SEAT, ARM, LAP = 0.0, 1.0, 2.0, 3.0, 4.0
"""Where a hand is: hanging, on its own thigh, on the seat beside the thighs, on an arm of the seat, in the lap."""
PLACES = ("hangs", "thigh", "seat", "arm", "lap")


@dataclass(frozen=True)
class SitStyle:
    """What a clip chooses beyond its start and its seat; stored with it. What is chosen or not is 1 or -1."""

    body_scale: float
    """Size of the body."""
    speed: float
    """Walking speed [m/s]."""
    sit_duration: float
    """From where the hips begin to sink until they rest on the seat [s]; two thirds of it are the way itself."""
    lean: float
    """How far the line from pelvis to shoulders pitches forward on the way down [rad]."""
    recline: float
    """How far the pelvis leans back in the end, without support [rad]; negative for who leans on the knees."""
    seat_x: float
    """Offset of the seated pelvis [m], forward, before it slides back."""
    seat_y: float
    """Offset of the seated pelvis and of the feet from the middle of the seat [m], to the left."""
    arm_swing: float
    """Swing of the arms, as a share of the usual."""
    duration: float = 0.0
    """Length of the clip, with a rest at its end, at least [s]."""
    pause: float = 0.3
    """From the last touch-down until the hips begin to sink [s]."""
    left_down: float = HANGS
    """Where the left hand goes on the way down: one of `PLACES`, by number."""
    right_down: float = HANGS
    """And the right one."""
    left_rest: float = THIGH
    """Where the left hand rests in the end."""
    right_rest: float = THIGH
    """And the right one."""
    left_along: float = 0.6
    """How far in front it rests, from 0 to 1: towards the knee, or towards the front of the seat or of its arm."""
    right_along: float = 0.6
    """And the right one."""
    left_late: float = 0.0
    """How much later than usual it gets there, on the way down and then in the end [s]."""
    right_late: float = 0.0
    """And the right one."""
    hang: float = 0.75
    """How much of the trunk's lean hanging arms make up for: 1 hangs down, less stays behind."""
    elbows: float = 0.3
    """How far elbows point outward: a share of straight back."""
    knees: float = 0.0
    """How far the knees open on the way down [rad], each."""
    twist: float = 0.0
    """How far the chest turns to the left on the way down [rad]."""
    tilt: float = 0.0
    """How far the chest tilts to the right on the way down [rad]."""
    nod: float = 0.0
    """How far the head nods on the way down [rad], beyond what the trunk leans."""
    look: float = 0.0
    """How far the head turns to the seat before the back is turned to it, as a share of all the way."""
    drop: float = 0.0
    """How much of the way down ends in a fall [m]."""
    back: float = 0.0
    """How far the pelvis slides back in the end, where there is room [m]."""
    against: float = -1.0
    """Whether it slides back until the trunk leans against the back of the seat."""
    lean_back: float = 0.0
    """How far the pelvis then leans [rad], or a little more or less, as the back allows."""
    slump: float = 0.1
    """How far the chest is bent forward over the pelvis in the end [rad]."""
    aside: float = 0.0
    """How far the chest tilts to the right in the end [rad]."""
    askew: float = 0.0
    """How far pelvis and chest are turned to the left in the end [rad]."""
    left_foot: float = 0.0
    """How far the left foot goes forward once the seat bears [m], at most; back under the seat if negative."""
    right_foot: float = 0.0
    """And the right one."""
    apart: float = 0.0
    """How much farther apart they come [m]."""
    first: float = 1.0
    """Which foot goes first: 1 the left one, -1 the right one."""
    lead: float = 0.0
    """How much of the walk is left out, so that the clip begins in motion [s]."""
    habits: float = 0.0
    """A whole number that names the small motions of who rests (`body.liveliness`); the negative one is the same in a
    mirror."""

    def down(self, side: int) -> float:
        """Where the left (0) or right (1) hand goes on the way down."""
        return (self.left_down, self.right_down)[side]

    def rest(self, side: int) -> float:
        """Where it rests in the end."""
        return (self.left_rest, self.right_rest)[side]

    def along(self, side: int) -> float:
        """How far in front it rests, from 0 to 1."""
        return (self.left_along, self.right_along)[side]

    def late(self, side: int) -> float:
        """How much later than usual it gets there [s]."""
        return (self.left_late, self.right_late)[side]


WAYS_DOWN: dict[tuple[float, float], float] = {
    (ARM, ARM): 0.26,
    (ARM, THIGH): 0.12,
    (ARM, HANGS): 0.10,
    (THIGH, THIGH): 0.11,
    (THIGH, HANGS): 0.10,
    (SEAT, SEAT): 0.10,
    (SEAT, HANGS): 0.07,
    (SEAT, THIGH): 0.07,
    (HANGS, HANGS): 0.07,
}
"""What one hand and the other look for on the way down, and how often: real people touch something."""
RESTS: dict[float, float] = {THIGH: 0.36, ARM: 0.20, SEAT: 0.22, LAP: 0.12, HANGS: 0.10}
"""Where a hand rests in the end, unless it stays on an arm, or both lie in the lap."""
STAYS, BOTH_IN_LAP = 0.6, 0.14
"""How often a hand stays on the arm of the seat that it took on the way down, and how often both go to the lap."""
AGAINST, ON_KNEES = 0.64, 0.12
"""How many people lean against the back of a seat, and how many sit bent forward."""


def plain(style: SitStyle) -> SitStyle:
    """The same without what follows from a seat's arms and back, of which no goal tells: hands on the thighs, nobody
    slides back, leans on anything, or moves the feet once seated.
    """
    return replace(
        style,
        left_down=THIGH,
        right_down=THIGH,
        left_rest=THIGH,
        right_rest=THIGH,
        left_along=0.6,
        right_along=0.6,
        left_late=0.1,
        right_late=0.1,
        hang=0.75,
        elbows=0.3,
        nod=0.0,
        back=0.0,
        against=-1.0,
        slump=0.1,
        left_foot=0.0,
        right_foot=0.0,
        apart=0.0,
    )


def draw_manner(random: np.random.Generator) -> dict[str, float]:
    """How somebody sits down and gets comfortable: fields of a SitStyle, the same for all seats."""
    ways, first = list(WAYS_DOWN), bool(random.integers(2))
    down = ways[random.choice(len(ways), p=list(WAYS_DOWN.values()))]
    rest = [float(place) for place in random.choice(list(RESTS), 2, p=list(RESTS.values()))]
    stays = random.uniform(size=2) < STAYS
    # nobody's hand goes to an arm of the seat from below it
    rest = [THIGH if place == ARM and at not in (ARM, THIGH) else place for at, place in zip(down, rest, strict=True)]
    rest = [ARM if at == ARM and stay else place for at, place, stay in zip(down, rest, stays, strict=True)]
    if random.uniform() < BOTH_IN_LAP:
        rest = [LAP, LAP]
    knees, against = random.uniform() < ON_KNEES, random.uniform() < AGAINST
    if knees:
        rest = [THIGH, THIGH]
    late = random.permutation([0.0, random.uniform(0.05, 0.7)]) + random.uniform(0.0, 0.25)
    if first:
        down, rest = down[::-1], rest[::-1]
    # the chest turns and tilts towards the hand that looks for a support alone
    alone = float(down[0] in (ARM, SEAT)) - float(down[1] in (ARM, SEAT))
    out, ahead = random.uniform(-0.05, 0.30), random.uniform(-0.22, 0.22)
    return {
        "pause": random.uniform(-0.05, 0.25),
        "lean": float(np.clip(0.89 + 0.12 * random.standard_normal(), 0.66, 1.10)),
        "recline": random.uniform(-0.45, -0.15) if knees else random.uniform(0.0, 0.30),
        "slump": random.uniform(*((0.25, 0.50) if knees else (0.0, 0.08) if against else (0.10, 0.50))),
        "against": 1.0 if against and not knees else -1.0,
        "lean_back": random.uniform(0.20, 0.55),
        "back": random.uniform(0.0, 0.26),
        "left_down": down[0],
        "right_down": down[1],
        "left_rest": rest[0],
        "right_rest": rest[1],
        "left_along": random.uniform(),
        "right_along": random.uniform(),
        "left_late": float(late[0]),
        "right_late": float(late[1]),
        "hang": random.uniform(0.35, 0.85),
        "elbows": random.uniform(0.6, 1.7),
        "knees": random.uniform(0.02, 0.22),
        "twist": 0.22 * alone * random.uniform(0.2, 1.0) + random.uniform(-0.08, 0.08),
        "tilt": -0.18 * alone * random.uniform(0.2, 1.0) + random.uniform(-0.05, 0.05),
        "nod": random.uniform(-0.30, 0.08),
        "look": random.uniform(0.3, 1.0),
        "aside": float(np.clip(0.10 * random.standard_normal(), -0.22, 0.22)),
        "askew": random.uniform(-0.20, 0.20),
        "left_foot": out + ahead,
        "right_foot": out - ahead,
        "apart": random.uniform(-0.03, 0.26),
        "first": float(random.choice([-1, 1])),
        "habits": float(random.integers(1, 2**24)),
    }
