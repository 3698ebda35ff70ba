"""What can be set of how episodes start, known without torch."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ClipStartConfig:
    """Where in its clip an episode starts, and how far from it."""

    first_frame: float = 0.1
    """Share of episodes that start at the clip's first frame; the others start anywhere in it."""
    pos_noise: float = 0.03
    """Standard deviation of the root's start position [m]; a third of it upwards."""
    angle_noise: float = 0.03
    """Standard deviation of the root's start orientation and of the joint angles [rad]."""
    vel_noise: float = 0.2
    """Standard deviation of the root's [m/s, rad/s] and half of the joints' [rad/s] start velocities."""
