"""What is worse than in training: pushes, a slippery floor, another mass, late targets, sensors that err."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from mimicbench.envs.hooks import ActionDelay, ActionNoise, Hook, Pushes
from mimicbench.envs.vec_env import EnvConfig


@dataclass(frozen=True)
class Disturbance:
    """One world that is harder than the benchmark's, or several troubles at once."""

    push: float = 0.0
    """Standard deviation of the horizontal velocity that a push adds [m/s]."""
    push_interval: float = 2.0
    """Mean time between pushes [s]."""
    action_noise: float = 0.0
    """Standard deviation of what is added to the targets [rad]."""
    delay: int = 0
    """Control steps by which targets come late."""
    friction: float = 1.0
    """Times the sliding friction that everything has."""
    mass: float = 1.0
    """Times the mass and inertia that the robot's links have."""
    noise: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)
    """Standard deviations of sensors' errors by the names of observations: of all numbers of one, or of each."""

    def hooks(self) -> list[Hook]:
        """What happens to robots while they act."""
        found: list[Hook] = [Pushes(self.push, self.push_interval)] if self.push else []
        found += [ActionNoise(self.action_noise)] if self.action_noise else []
        return [*found, *([ActionDelay(self.delay)] if self.delay else [])]

    def of(self, config: EnvConfig) -> EnvConfig:
        """The environment's configuration in that world."""
        physics = replace(config.physics, friction=self.friction, mass=self.mass)
        return replace(config, physics=physics, noise={**config.noise, **self.noise})
