"""How somebody lies down: the choices of a clip, and its clocks."""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core.seeds import rng
from mimicbench.references.actions.berths import Berth
from mimicbench.references.actions.resting_hands import BELLY, BESIDE, CHEST, HEAD, SPOTS, UP
from mimicbench.references.body.body import Body
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.walking import Walk

PAUSE = 0.35
"""Between the last step and the first bend [s]."""
LYING_TIME = 6.1
"""From when the first leg goes up to rest at pace 1 [s]."""
PROPS = 0.8
"""Who sits puts the hands down beside and behind, and leans back on them, so long before the first leg goes up, at pace
1 [s]."""
TURNING_TIME = 2.8
"""From the back onto the side at pace 1 [s]."""
NEAR_TRUNK = {BESIDE: BELLY, UP: BELLY, HEAD: CHEST}
"""Where the hands of who turns onto the side are before, instead of elsewhere."""
HAND_SHARES = (0.28, 0.24, 0.14, 0.08, 0.12, 0.14)
"""How often hands rest at each of the spots of `resting_hands`."""
LATER = (0.12, 0.40)
"""How much later one hand goes than the other while somebody sits down, in durations of the way down."""
SWINGS = (0.8, 1.3)
"""How far an arm swings forward then, as a share of the usual: less, and a late hand would meet the bed's edge."""
HANGS = 0.45
"""Share of people of whom one hand does not go to the thigh then, but hangs until it is put down on the bed."""


@dataclass(frozen=True)
class LieStyle:
    """What a clip chooses beyond its start and its object; stored with it."""

    body_scale: float
    """Size of the body; 1 is 1.6 m tall."""
    speed: float
    """Walking speed [m/s]."""
    sit_duration: float
    """From the first bend to the seat [s]."""
    pace: float
    """How slowly the person lies down; 1 takes PROPS and LYING_TIME from the seat to rest."""
    lean: float
    """How far pelvis and trunk pitch forward on the way down [rad]."""
    stagger: float
    """The second leg follows the first one after this time, at pace 1 [s]."""
    stretch: float
    """How far the legs are stretched that are, as a share of their length, where there is room."""
    bent: float
    """And those whose knee stays up."""
    left_up: float
    """1 if the left knee stays up, 0 if not."""
    right_up: float
    """1 if the right knee stays up, 0 if not."""
    side: float
    """1 for who turns onto the side in the end, towards the free edge; 0 for who stays on the back."""
    left_hand: float
    """Where the left hand rests on the back: one of `resting_hands`."""
    right_hand: float
    """Where the right hand rests on the back: one of `resting_hands`."""
    arm_swing: float
    """Swing of the arms while walking, as a share of the usual."""
    duration: float
    """Of the whole clip, if walking and lying down leave something of it for the rest [s]."""
    lead: float = 0.0
    """How much of the walk is left out, so that the clip begins in motion [s]."""
    left_farther: float = 0.0
    """How much farther from the middle, or up the body, the left hand rests than usual, at body size 1 [m]."""
    right_farther: float = 0.0
    """And the right hand."""
    apart: float = 0.0
    """How much farther apart than the hips the feet rest where there is room, each, at body size 1 [m]."""
    splay: float = 0.0
    """How far knees that are up lean out [rad]."""
    later: float = 3.0
    """When who is at rest changes the posture once more [s]."""
    later_hand: float = 0.0
    """1 to move the left hand then, -1 the right one, 0 none."""
    later_spot: float = 0.0
    """Where to: one of `resting_hands`."""
    later_leg: float = 0.0
    """1 to draw up or stretch the left leg then, -1 the right one, 0 none."""
    turns: float = 5.8
    """When on the clock who turns onto the side begins to, at pace 1 [s]."""
    askew: float = 0.0
    """How far both knees lean to the left if both are up [rad]; only off the edge where there is no room."""
    roll: float = 1.35
    """How far who turns onto the side does [rad]."""
    curl: float = 0.85
    """How far the thighs are drawn up then [rad]."""
    habits: float = 0.0
    """A whole number from which follows how the person breathes, looks and settles."""


def draw_style(random: np.random.Generator, body_scale: float, duration: float, pace: tuple[float, float]) -> LieStyle:
    """The free choices of a clip, given the body's size, the clip's duration [s] and the range of its pace.

    Who is quicker walks faster, too.
    """
    quick = pace[1] < 0.9
    slow = random.uniform(*pace)
    up = random.choice([0, 0, 1, 2, 3], p=[0.25, 0.2, 0.2, 0.2, 0.15])
    return LieStyle(
        body_scale=body_scale,
        speed=random.uniform(0.70, 0.82),
        sit_duration=random.uniform(1.85, 2.15) if quick else random.uniform(2.2, 2.9),
        pace=slow,
        lean=random.uniform(0.60, 0.72),
        stagger=random.uniform(0.65, 0.95) / slow,
        stretch=random.uniform(0.72, 0.985),
        bent=random.uniform(0.53, 0.66),
        left_up=float(up in (1, 3)),
        right_up=float(up in (2, 3)),
        side=0.0,
        left_hand=float(random.choice(SPOTS, p=HAND_SHARES)),
        right_hand=float(random.choice(SPOTS, p=HAND_SHARES)),
        arm_swing=random.uniform(0.7, 1.2),
        duration=duration,
        lead=random.uniform(0.3, 1.5) if quick else 0.0,
        left_farther=random.uniform(-0.05, 0.09),
        right_farther=random.uniform(-0.05, 0.09),
        apart=random.uniform(-0.02, 0.14),
        splay=random.uniform(-0.05, 0.35) if up < 3 else random.uniform(-0.08, 0.15),
        askew=random.uniform(-0.4, 0.4) if up == 3 else 0.0,
        later=random.uniform(1.2, 5.0),
        later_hand=float(random.choice([0, 1, -1])),
        later_spot=float(random.choice(SPOTS, p=HAND_SHARES)),
        later_leg=float(random.choice([0, 1, -1], p=[0.5, 0.25, 0.25])),
        roll=random.uniform(1.2, 1.45),
        curl=random.uniform(0.55, 1.15),
        habits=float(random.integers(1, 1 << 20)),
    )


@dataclass(frozen=True)
class Lying:
    """Who lies down where, after which walk, and when what happens; of T frames."""

    body: Body
    berth: Berth
    way: Walk
    style: LieStyle

    @property
    def sitting(self) -> np.ndarray:
        """(T,) from 0 at the first bend to 1 on the seat."""
        return (self.way.time - self.way.end - PAUSE) / self.style.sit_duration

    @property
    def clock(self) -> np.ndarray:
        """(T,) since the first leg goes up, PROPS after the seat, in seconds of pace 1."""
        return (self.way.time - self.way.end - PAUSE - self.style.sit_duration) / self.style.pace - PROPS

    @property
    def ends(self) -> float:
        """When on the clock who lies is at rest."""
        return time_to_lie(self.style)

    @property
    def rest(self) -> np.ndarray:
        """(T,) since then [s]."""
        return self.style.pace * (self.clock - self.ends)

    def hands(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How each hand (2,) goes its own way while somebody sits down, which follows from the person's habits: how
        much later, in durations of the way down, how far forward as a share of the usual, and whether to the thigh (1
        or 0).
        """
        random = rng(abs(int(self.style.habits)), "hands")
        late = random.permutation([0.0, random.uniform(*LATER)])
        far = random.uniform(*SWINGS, 2)
        thigh = np.ones(2)
        if random.uniform() < HANGS:
            thigh[random.integers(2)] = 0.0
        # of the near hand and the other one, so that they change sides in a mirror
        sides = [self.near, 1 - self.near]
        return late[sides], far[sides], thigh[sides]

    @property
    def spots(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Where the hands rest on the back, and where later."""
        first = (int(self.style.left_hand), int(self.style.right_hand))
        moves = self.style.later_hand if self.style.side < 0.5 else 0.0
        last = [int(self.style.later_spot) if moves == sign else first[side] for side, sign in enumerate((1.0, -1.0))]
        return first, (last[0], last[1])

    @property
    def near(self) -> int:
        """The side (0 left, 1 right) at the pillow's side of who sits, at the free edge's of who lies."""
        return 0 if self.berth.turn < 0 else 1

    def late(self, side: int) -> float:
        """How much later than the leg that is nearer to the foot end this one goes, on the clock."""
        return 0.0 if (1.0 - 2.0 * side) * self.berth.turn > 0 else self.style.stagger

    def swing(self, side: int) -> np.ndarray:
        """(T,) from 0, where a leg points out of the bed, to 1, along it: one leg after the other."""
        late = self.late(side)
        start, end = (0.38, 2.55) if late == 0.0 else (0.25 + late, 2.5 + 0.6 * late)
        return ease(self.clock, start, end)

    @property
    def turn(self) -> np.ndarray:
        """(T,) the same of the pelvis: between both legs."""
        return 0.5 * (self.swing(0) + self.swing(1))


def ease(clock: np.ndarray, start: float, end: float) -> np.ndarray:
    """From 0 at `start` to 1 at `end` of the clock (T,), at rest at both."""
    return minimum_jerk((clock - start) / (end - start))


def onto_the_side(style: LieStyle, turns: float) -> LieStyle:
    """The style of who turns onto the side from a time on the clock on: knees down and hands near the trunk before."""
    hands = [float(NEAR_TRUNK.get(int(hand), int(hand))) for hand in (style.left_hand, style.right_hand)]
    return replace(
        style, side=1.0, turns=turns, left_up=0.0, right_up=0.0, left_hand=hands[0], right_hand=hands[1], askew=0.0
    )


def time_to_lie(style: LieStyle) -> float:
    """From when the first leg goes up to rest, at pace 1 [s]."""
    return style.turns + TURNING_TIME if style.side > 0.5 else LYING_TIME


def needed_time(style: LieStyle) -> float:
    """From the last step to rest [s]."""
    return PAUSE + style.sit_duration + style.pace * (PROPS + time_to_lie(style)) + 0.3
