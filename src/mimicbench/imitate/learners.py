"""The learners by name, and their checkpoints."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mimicbench.core.building import built
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import UnknownName
from mimicbench.imitate.act import ACT, ACTConfig
from mimicbench.imitate.bc import BC, BCConfig
from mimicbench.imitate.inputs import Learner

LearnerConfig = ACTConfig | BCConfig
LEARNERS: dict[str, tuple[type[ACTConfig] | type[BCConfig], type[ACT] | type[BC]]] = {
    "act": (ACTConfig, ACT),
    "bc": (BCConfig, BC),
}
"""kind -> (configuration, network)."""


def make_learner(config: LearnerConfig) -> ACT | BC:
    """A new network of that configuration, with weights from torch's random numbers."""
    return ACT(config) if isinstance(config, ACTConfig) else BC(config)


def learner_kind(learner: Learner) -> str:
    """Its name in LEARNERS."""
    for kind, (_, network) in LEARNERS.items():
        if isinstance(learner, network):
            return kind
    raise UnknownName("learner", type(learner).__name__, list(LEARNERS))


def save_learner(folder: Path, learner: ACT | BC, robot: str, notes: Mapping[str, Any] | None = None) -> None:
    """Write a checkpoint whose kind is the learner's."""
    tensors = {name: value.detach().cpu().numpy() for name, value in learner.state_dict().items()}
    save_checkpoint(folder, learner_kind(learner), robot, learner.config, tensors, notes)


def load_learner(folder: Path, robot: str) -> ACT | BC:
    """Read what `save_learner` wrote. Raises BadCheckpoint or UnknownName."""
    checkpoint = load_checkpoint(folder, robot=robot)
    if checkpoint.kind not in LEARNERS:
        raise UnknownName("kind of learner", checkpoint.kind, list(LEARNERS))
    config = checkpoint.config_as(LEARNERS[checkpoint.kind][0])
    return built(checkpoint, lambda: make_learner(config), config.layers)
