"""A clone that practises: cloned from demonstrations first, then reinforced by what its own attempts come to.

Who copies demonstrations never learns what a mistake of his own leads to, and falls. So the clone goes on by PPO
(imitate.exploring): it tries the task beside objects of the training split, is rewarded for what K still lacks, and
pays for straying from what it was shown, as language models do for straying from what they had read (the divergence of
two normal distributions of one deviation is the squared difference of their means). What it was shown is how people do
it; what it is rewarded for is to get it done, and to stay.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mimicbench.core.checkpoint import beside
from mimicbench.imitate.cloning import CloneImitation, clone
from mimicbench.imitate.exploring.episodes import ExploreConfig
from mimicbench.imitate.exploring.network import Explorer, ExplorerConfig
from mimicbench.imitate.exploring.practice import Practice, course_of, practise
from mimicbench.imitate.inputs import InputConfig
from mimicbench.imitate.learned import load_learner
from mimicbench.imitate.spec import Given, LearnerSpec
from mimicbench.imitate.train import TrainConfig
from mimicbench.track.ppo_config import PPOConfig

CLONED = "cloned"
"""The folder of the clone, beside that of what it became."""


def _network() -> ExplorerConfig:
    inputs = InputConfig(body="proprio", memory=True, elevation=False, history=3)
    return ExplorerConfig(inputs=inputs, relative=True, hidden=(512, 256))


def _ppo() -> PPOConfig:
    return PPOConfig(steps=24, epochs=4, gamma=0.99, entropy=0.0, learning_rate=3e-4, initial_std=0.3)


@dataclass(frozen=True)
class ReinforcedImitation(Practice, CloneImitation):
    """Cloning, and practice."""

    learner: str = "reinforced"
    network: ExplorerConfig = field(default_factory=_network)
    train: TrainConfig = field(default_factory=lambda: TrainConfig(steps=10_000))
    ppo: PPOConfig = field(default_factory=_ppo)
    explore: ExploreConfig = field(default_factory=lambda: ExploreConfig(num_envs=512, power=0.1, stray=0.01))


def learn(folder: Path, given: Given, config: ReinforcedImitation) -> dict[str, Any]:
    """Learn into a folder, or go on learning there."""
    cloned = beside(folder, CLONED)
    told = clone(cloned, given, config)
    explorer, _ = load_learner(cloned, given.clips.robot, ExplorerConfig)
    assert isinstance(explorer, Explorer)
    return {**told, **practise(folder, given, config, course_of(config), explorer, cloned=True)}


LEARNER = LearnerSpec("reinforced", ReinforcedImitation, learn)
