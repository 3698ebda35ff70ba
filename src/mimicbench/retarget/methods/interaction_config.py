"""How `interaction` retargeting weighs its residuals, and how long it goes on."""

from dataclasses import dataclass


@dataclass(frozen=True)
class InteractionConfig:
    """How large each residual may be; half as large counts four times as much."""

    position: float = 0.06
    """Of a link from the point that it follows [m]."""
    orientation: float = 0.25
    """Of a limb from the human's [rad]."""
    lean: float = 0.05
    """Of a trunk from the person's, sitting and lying [rad]."""
    foot: tuple[float, float] = (0.002, 0.02)
    """Of a foot from its anchor, standing and swinging [m]."""
    foot_rest: float = 0.015
    """The same where it rests on the object [m]."""
    foot_turn: tuple[float, float] = (0.03, 0.3)
    """The same of its orientation [rad]."""
    hand: tuple[float, float] = (0.008, 0.3)
    """Of a wrist from its anchor, in contact and far from any [m]."""
    contact: float = 0.004
    """Of a bearing part from the surface [m]."""
    clearance: float = 0.002
    """Depth in floor or object [m]."""
    self_clearance: float = 0.005
    """Depth in the robot's own other parts [m]."""
    margin: float = 0.003
    """Shapes keep this far away from floor and object [m]; what bears, and soles, may touch."""
    balance: float = 0.01
    """Of the center of mass from where it is in balance [m]."""
    support: tuple[float, float] = (-0.03, 0.12)
    """Where that is: behind and in front of the middle of the ankles [m]."""
    perch: float = 0.02
    """Where it is, at least, while only the root bears: in front of where it does [m]. A robot's trunk is heavier than
    a person's, and its legs are not: who swings them up as upright as people tips over backwards."""
    perch_error: float = 0.01
    """How far it may be off that [m]."""
    leaning_from: float = 0.5
    """[rad] that a person's trunk is tilted from which on the hands bear it."""
    lying_from: float = 1.3
    """[rad] and until when."""
    before_sitting: float = 0.4
    """[s] Before the pelvis bears, balance no longer counts: people let themselves fall the last bit."""
    acceleration: float = 12.0
    """Of a joint [rad/s^2]."""
    root_acceleration: float = 3.0
    """[m/s^2]"""
    velocity_share: float = 0.8
    """Share of a joint's velocity limit that it may use."""
    velocity: float = 0.2
    """Beyond that share [rad/s]."""
    slides: tuple[float, ...] = (0.08, 0.16, 0.24)
    """How far towards its feet a body is put, one after the other until it rests [m]. On a seat higher than its knees a
    robot with long thighs lies on the front edge with them and hovers with its buttocks; on a bed of people's length a
    taller one has its head in the board."""
    heels: tuple[float, ...] = (0.25, 0.45)
    """How far who sits raises the heels, one after the other until the trunk leans as the person's and touches what it
    leans against [rad]. Shanks too short for a high seat hold the knees, and so the pelvis, at its front."""
    off: float = 0.09
    """[rad] that a trunk may be off the person's without that."""
    hover: float = 0.02
    """[m] of buttocks above the seat that is still rest, and of a head in a board that may be mended without that."""
    rough_fps: float = 10.0
    """Frames per second at which it is decided how to get through the scene; then all frames are solved from there."""
    rough_tolerance: float = 2e-2
    """`tolerance` there."""
    iterations: int = 25
    """Gauss-Newton steps at most."""
    tolerance: float = 5e-3
    """Stop when a step lowers the loss by less than this part of it."""
    patience: int = 1
    """So many steps together, on average."""


LYING = InteractionConfig(rough_tolerance=5e-3, patience=2)
"""Of clips that end lying. Much touches at once there, and the loss falls unevenly: where a step gained little the next
ones gained up to a third of it."""
