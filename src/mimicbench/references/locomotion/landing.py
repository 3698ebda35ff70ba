"""How a leg comes down: its knee straightens evenly until the foot lands, however the pelvis moves meanwhile."""

from dataclasses import replace

import numpy as np

from mimicbench.references.body.body import Body
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.feet import Feet, roll_of, sole_depth
from mimicbench.references.locomotion.gait import Footsteps
from mimicbench.references.locomotion.height import STRAIGHTEST, Hips

WITHIN = 0.44
"""The last share of a swing in which the knee is led."""
ROUND = 0.15
"""[rad] Where it would be bent more anyhow it is not led; it comes to that as gradually as this."""
EASES = 4.0
"""[rad/s^2] The knee is led along a parabola that ends as the knee is, and goes on, when the foot has landed."""
SHORT, LONG = 0.35, 0.75
"""In strides from the first to the second share of a long one; in shorter ones the knee is only kept from being
straighter."""
SLACK = 0.003
"""[m] A foot in the air is raised before it is out of reach by that."""
SOON = 0.1
"""[s] after a beginning in motion."""
KEEPS = 0.5
"""The sole stays over the floor by this share of the height that it would have."""
CLEARS = 0.001
"""[m] And by this."""


def land_softly(body: Body, hips: Hips, height: np.ndarray, feet: Feet, steps: Footsteps, time: np.ndarray) -> Feet:
    """The feet, those in the air raised or lowered before they land, given the pelvis' height (T,) [m]."""
    upper, lower = body.length(body.legs[0])
    fps = 1.0 / float(time[1] - time[0])
    low = sole_depth(body, feet.pitch, feet.toe_bend)
    pos, places = feet.pos_w.copy(), steps.first_xy.copy()
    for side, xy, yaw, lift, land in zip(
        steps.side, steps.xy, steps.yaw, steps.lift_off, steps.touch_down, strict=True
    ):
        roll = roll_of(xy - places[1 - side], yaw, body.leg_length)
        long = float(minimum_jerk(np.array((roll - SHORT) / (LONG - SHORT))))
        places[side] = xy
        first, landed = np.searchsorted(time, (max(land - WITHIN * (land - lift), 0.0), land))
        if landed <= first or landed >= len(time):
            continue
        some = slice(first, min(landed + 2, len(time)))
        away = ((hips.xy[some, side] - pos[some, side, :2]) ** 2).sum(-1)
        hip = height[some] + hips.above[some, side]
        reach = (away + (hip - pos[some, side, 2]) ** 2 - upper**2 - lower**2) / (2 * upper * lower)
        knee = np.arccos(np.clip(reach, -1.0, 1.0))
        count = landed - first
        left = time[landed] - time[some]
        goes_on = np.clip((knee[-1] - knee[count]) * fps, 0.0, np.sqrt(4 * EASES * max(knee[count] - STRAIGHTEST, 0.0)))
        share, bent = left / max(left[0], 1e-6), knee[count] - goes_on * left + EASES * left**2 - knee
        more = np.maximum(bent, 0.0) ** 2 / (np.maximum(bent, 0.0) + ROUND * share + 1e-9)
        knee = knee + minimum_jerk(2.0 * (1.0 - share)) * (long * bent + (1.0 - long) * more)
        reach = upper**2 + lower**2 + 2 * upper * lower * np.cos(knee) - away
        least = low[some, side] + np.maximum(KEEPS * (pos[some, side, 2] - low[some, side]), CLEARS)
        pos[first:landed, side, 2] = np.maximum(hip - np.sqrt(np.maximum(reach, 0.0)), least)[:count]
    # however long a step is, no foot in the air is out of reach, or in the floor
    short = height[:, None] - replace(hips, ankle=pos).height(body, STRAIGHTEST)
    raised = 0.5 * minimum_jerk(time / SOON)[:, None] * (short + np.hypot(short, SLACK))
    pos[..., 2] = np.where(feet.contact, pos[..., 2], np.maximum(pos[..., 2] + raised, low))
    return replace(feet, pos_w=pos)
