"""HIT, the humanoid imitation transformer (Fu et al. 2024), as the paper uses it (appendix G): a planner of target
poses over the tracker.

One transformer without a decoder reads [state, one token per map feature, one learned query per frame of the chunk],
all of which see each other. What comes out at the queries are the poses of the two frames after each frame of the
chunk, as seen from where the robot is now (imitate.plan.PosePlan); at the map's tokens, the features that the map will
have when the chunk is over, so that the map cannot be overlooked:

    loss = L1(poses) + feature_weight * |tokens of the map - features of the map after the chunk|^2

Where demonstrations follow no clip, but were given by a policy, the poses are those that the demonstrations come to.

In use only the first frames of the chunk count, as many as the tracker looks ahead: completed by differences and
forward kinematics they are what the tracker is told, in every frame anew.

Four things differ from the original program on purpose. It sees photographs of two cameras, with an image network that
was learned on others; here it sees the paper's elevation map, and learns to. Numbers of the poses have their mean and
deviation in each frame of the chunk: the next frame is centimeters away, the last one a meter. And the original says
the joint angles of one frame; here it says the paper's poses of two, from which velocities follow, the second one by
how it differs from the first.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core.checkpoint import beside
from mimicbench.imitate.encoder import Encoder, sine_positions_2d
from mimicbench.imitate.goals import known_goal
from mimicbench.imitate.inputs import Batch, Learner
from mimicbench.imitate.learned import load_learner
from mimicbench.imitate.learners.hit import HITConfig
from mimicbench.imitate.plan import PosePlan
from mimicbench.imitate.planner import own_terms
from mimicbench.imitate.policy import Senses
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations
from mimicbench.sim.rows import Rows
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.history import Follower
from mimicbench.track.tracker import Tracker


class HIT(Learner):
    """State and map -> plans."""

    kind = "hit"

    def __init__(self, config: HITConfig) -> None:
        super().__init__(config.inputs, (config.chunk, config.action_size))
        self.config = config
        width = config.hidden
        self.state_to_token = nn.Linear(config.inputs.seen_size, width)
        self.state_position = nn.Parameter(torch.randn(1, 1, width) * 0.02)
        if config.inputs.sees:
            self.map_encoder = Encoder(replace(config.encoder, channels=config.inputs.seen_channels))
            self.map_to_token = nn.Conv2d(config.encoder.widths[-1], width, 1)
            self.register_buffer("map_positions", sine_positions_2d(config.encoder.side, width), persistent=False)
        self.queries = nn.Parameter(torch.randn(1, config.chunk, width) * 0.02)
        self.blocks = nn.ModuleList(_Block(config) for _ in range(config.blocks))
        self.head = nn.Linear(width, config.action_size)

    def loss(self, batch: Batch, generator: torch.Generator | None = None) -> dict[str, Tensor]:
        """L1 over the frames of the chunk that exist, and the error of the map's features after it."""
        found, foreseen = self._forward(batch.vector, batch.picture)
        l1 = ((found - self.normalized_actions(batch.actions)).abs() * ~batch.pad[..., None]).mean()
        if batch.ahead is None:
            return {"loss": l1, "l1": l1}
        feature = functional.mse_loss(foreseen, self._features(batch.ahead))
        return {"loss": l1 + self.config.feature_weight * feature, "l1": l1, "feature": feature}

    def plan(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """The plans (N, chunk, P), in meters, radians and seconds."""
        return self._forward(vector, picture)[0] * self.action_std + self.action_mean

    def _features(self, picture: Tensor) -> Tensor:
        """(N, side * side, hidden) one token per map feature."""
        return self.map_to_token(self.map_encoder(self.normalized_map(picture))).flatten(2).transpose(1, 2)

    def _forward(self, vector: Tensor, picture: Tensor | None) -> tuple[Tensor, Tensor]:
        """Normalized plans (N, chunk, P), and what has become of the map's tokens (N, side * side, hidden)."""
        tokens = [self.state_to_token(self.normalized_input(vector))[:, None] + self.state_position]
        if self.inputs.sees:
            if picture is None:
                raise ValueError("this learner sees pictures; give it one")
            tokens.append(self._features(picture) + self.get_buffer("map_positions"))
        x = torch.cat([*tokens, self.queries.expand(len(vector), -1, -1)], 1)
        for block in self.blocks:
            x = block(x)
        return self.head(x[:, -self.config.chunk :]), x[:, 1 : -self.config.chunk]


class _Block(nn.Module):
    """Self-attention and feed-forward; the sums go on from what has been normalized, as in the original."""

    def __init__(self, config: HITConfig) -> None:
        super().__init__()
        width = config.hidden
        self.heads, self.dropout = config.heads, config.dropout
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(3))
        self.mix, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.feedforward = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width), nn.Dropout(config.dropout)
        )
        self.drop = nn.Dropout(config.dropout)

    def forward(self, x: Tensor) -> Tensor:
        x = self.norms[0](x)
        query, key, value = (part.unflatten(-1, (self.heads, -1)).transpose(1, 2) for part in self.mix(x).chunk(3, -1))
        dropout = self.dropout if self.training else 0.0
        mixed = functional.scaled_dot_product_attention(query, key, value, dropout_p=dropout)
        x = self.norms[1](x + self.drop(self.out(mixed.transpose(1, 2).flatten(2))))
        return self.norms[2](x + self.feedforward(x))


class HITPolicy:
    """HIT in closed loop: plans in every frame, and lets the tracker follow."""

    def __init__(self, robot: Robot, task: Task, learner: Learner, tracker: Tracker, senses: Senses) -> None:
        self._robot, self._learner, self._tracker, self._senses = robot, learner.eval(), tracker, senses
        self._plan = PosePlan(robot, task)
        # targets of wrists are among what is planned
        self._own = tuple(name for name in own_terms(tracker.spec, task) if name != "targets")
        self.gains = tracker.spec.gains
        self.observations: tuple[str, ...] = tuple(dict.fromkeys((*senses.observations, *self._own)))
        self._last_action, self._follower = torch.zeros(0, len(robot.joints)), Follower(tracker, 0)

    def to(self, device: str) -> None:
        """Move the networks to a device."""
        self._learner.to(device)
        self._tracker.network.to(device)
        self._senses.to(device)
        self._last_action = self._last_action[:0].to(device)

    @torch.no_grad()
    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Nothing was done before."""
        self._senses.begin(ids, obs)
        robots, device = obs.num_envs, obs["proprio"].device
        if len(self._last_action) != robots:
            self._last_action = torch.zeros(robots, len(self._robot.joints), device=device)
            self._follower = Follower(self._tracker, robots, device)
        self._last_action = self._last_action.index_fill(0, ids, 0.0)
        self._follower.history.begin(Rows.of(ids, robots, device))

    def networks(self) -> list[nn.Module]:
        """All that it runs on."""
        return [self._learner, self._tracker.network, *self._senses.networks()]

    def memory(self) -> dict[str, Tensor]:
        """(N, ...) what is carried from frame to frame, by name."""
        return {"last_action": self._last_action, **self._follower.history.state_tensors(), **self._senses.memory()}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        self._last_action = memory["last_action"]
        self._follower.history.load_state_tensors(memory)
        self._senses.remember(memory)

    @torch.no_grad()
    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad]."""
        chunk = self._learner.plan(*self._senses.see(obs))
        planned = self._plan.terms(self._tracker.spec, chunk, obs["proprio"])
        terms = {**{name: obs[name] for name in self._own}, "last_action": self._last_action, **planned}
        self._last_action, self._before = self._follower.action(terms), terms
        return self._tracker.target(self._robot, terms, self._last_action)

    def drove(self, target: Tensor) -> None:
        """Joint targets (N, J) [rad] were given instead of what `act` said last: it goes on from there."""
        self._last_action = self._tracker.actions_of(self._robot, self._before, target)


def load_hit(folder: Path, robot: Robot, task: Task) -> HITPolicy:
    """Read a policy with the `tracker` in the folder beside it. Raises BadCheckpoint, or as `check_told`."""
    learner, _ = load_learner(folder, robot, HITConfig)
    goal = known_goal(beside(folder, "perception"), robot, task) if learner.inputs.memory else None
    tracker = load_tracker(beside(folder, "tracker"), robot)
    check_told(robot, task, tracker, learner.config.chunk)
    return HITPolicy(robot, task, learner, tracker, Senses(learner.inputs, goal))


def check_told(robot: Robot, task: Task, tracker: Tracker, chunk: int) -> None:
    """Raise MimicbenchError if plans of so many frames do not say all that a tracker has to be told."""
    plan = PosePlan(robot, task)
    plan.terms(tracker.spec, torch.zeros(1, chunk, plan.size), torch.zeros(1, 10 + 2 * len(robot.joints)))
