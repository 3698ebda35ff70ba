"""Somebody who walks straight ahead and stops, without an object: the gait alone."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.references.body.body import Body
from mimicbench.references.body.posing import Trunk, pose
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.route import Route
from mimicbench.references.locomotion.walking import FPS, UPRIGHT, Walk, walk


def straight_way(body: Body, gait: Gait, length: float) -> Walk:
    """A walk of some length [m] along +x, and a second of standing."""
    end = np.array([length, 0.0])
    return walk(body, Route(np.array([[0.0, 0.0], end])), 0.0, end, 0.0, gait, 1.0)


def clip_of_walk(body: Body, way: Walk) -> HumanMotion:
    """A walk as a clip, with nothing else to do than walk."""
    still = np.zeros(len(way.time))
    pelvis = way.pelvis_quat(still + UPRIGHT)
    chest = rot.multiply(pelvis, way.chest_turn(still))
    trunk = Trunk(way.pelvis_pos_w, pelvis, chest, rot.multiply(chest, way.head_turn(still)))
    quat = pose(body, trunk, way.legs(), way.arms(body, 1.0))
    contact = ("left_foot", "right_foot"), way.feet.contact
    return HumanMotion("walk", "none", body.skeleton, FPS, way.pelvis_pos_w, quat, "none", *contact)
