"""Learners in their closed loop."""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.goals import KnownGoal
from mimicbench.imitate.inputs import Learner
from mimicbench.imitate.settings.inputs import InputConfig
from mimicbench.sensors.observations import Observations

BODY = ("proprio", "time", "odometry")
"""What every policy observes beside maps and goals."""


class Senses:
    """What learners see of N robots, frame by frame: vectors and maps, with as many past frames as they were shown."""

    def __init__(self, inputs: InputConfig, goal: KnownGoal | None = None) -> None:
        """`goal` is needed, and used, if the learner remembers it."""
        if inputs.memory and goal is None:
            raise MimicbenchError("this policy remembers its goal; give it what it knows of that, too")
        self._inputs, self.goal = inputs, goal if inputs.memory else None
        self._maps = (
            *(("views",) if inputs.views else (inputs.map_term,) if inputs.elevation else ()),
            *(("target_elevation",) if inputs.targets and not inputs.views else ()),
        )
        wanted = (
            *(("state",) if inputs.body == "state" else ()),
            *BODY,
            *self._maps,
            *(self.goal.observations if self.goal else ()),
        )
        self.observations: tuple[str, ...] = tuple(dict.fromkeys(wanted))
        self._past: list[tuple[Tensor, Tensor | None]] = []

    def to(self, device: str) -> None:
        """Move what perceives to a device; nothing is remembered."""
        self._past = []
        if self.goal is not None:
            self.goal.to(device)

    def networks(self) -> list[nn.Module]:
        """Those that perceive."""
        return self.goal.networks() if self.goal else []

    def memory(self) -> dict[str, Tensor]:
        """(N, ...) what is carried from frame to frame, by name."""
        found = {f"goal.{name}": value for name, value in self.goal.memory().items()} if self.goal else {}
        for number, (vector, maps) in enumerate(self._past):
            found |= {f"vector.{number}": vector, **({} if maps is None else {f"maps.{number}": maps})}
        return found

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        if self.goal:
            self.goal.remember({n.removeprefix("goal."): v for n, v in memory.items() if n.startswith("goal.")})
        numbers = range(len(self._past))
        self._past = [(memory[f"vector.{number}"], memory.get(f"maps.{number}")) for number in numbers]

    def begin(self, ids: Tensor, obs: Observations) -> None:
        """Robots `ids` (M,) begin anew: they find out about the goal, and before their first frame was the same one."""
        if self.goal is not None:
            self.goal.begin(ids, obs)
        if self._inputs.history == 1:
            return
        vector, maps = self._frame(obs)
        if not self._past or len(self._past[0][0]) != len(vector):
            self._past = [(vector, maps)] * (self._inputs.history - 1)
        self._past = [
            (
                old.index_copy(0, ids, vector[ids]),
                None if seen is None or maps is None else seen.index_copy(0, ids, maps[ids]),
            )
            for old, seen in self._past
        ]

    def see(self, obs: Observations) -> tuple[Tensor, Tensor | None]:
        """The vectors (N, size) and what is seen (N, channels, 128, 128), or (N, history, ...) of both."""
        frame = self._frame(obs)
        if self._inputs.history == 1:
            return frame
        frames = [*self._past, frame]
        self._past = frames[1:]
        vectors, maps = zip(*frames, strict=True)
        return torch.stack(vectors, 1), torch.stack(maps, 1) if self._maps else None

    def _frame(self, obs: Observations) -> tuple[Tensor, Tensor | None]:
        memory = None if self.goal is None else self.goal.recall(obs)
        state = obs["state"] if self._inputs.body == "state" else obs["proprio"]
        vector = self._inputs.vector(state, obs["proprio"], obs["time"][:, 0], memory)
        return vector, _layers(obs, self._maps) if self._maps else None


def _layers(obs: Observations, names: Sequence[str]) -> Tensor:
    """(N, channels, 128, 128) terms of one channel or of several, one behind the other."""
    seen = [obs[name] for name in names]
    return torch.cat([one[:, None] if one.dim() == 3 else one for one in seen], 1)


class Ensemble:
    """Means of what the chunks of N robots say of the frames to come (temporal ensembling, Zhao et al. 2023): the i-th
    chunk that reaches a frame counts exp(-0.01 i) there, so that the oldest counts most.
    """

    def __init__(self) -> None:
        self.total, self.weight, self.count = torch.zeros(0, 0, 0), torch.zeros(0, 0), torch.zeros(0, 0)

    def begin(self, ids: Tensor, num_envs: int, like: Tensor) -> None:
        """Robots `ids` (M,) of N begin anew. `like` (.., chunk, A) is what they predict."""
        if len(self.count) != num_envs:
            shape = (num_envs, *like.shape[-2:])
            self.total, self.weight, self.count = (like.new_zeros(shape[:size]) for size in (3, 2, 2))
        self.total, self.weight, self.count = (
            kept.index_fill(0, ids, 0.0) for kept in (self.total, self.weight, self.count)
        )

    def mean(self, chunk: Tensor) -> Tensor:
        """(N, A) for the present frame, of another chunk (N, K, A) from there on. The next call is of the next one."""
        new = torch.exp(-0.01 * self.count)
        total, weight = self.total + new[..., None] * chunk, self.weight + new
        self.total, self.weight, self.count = (
            torch.cat([kept[:, 1:], torch.zeros_like(kept[:, :1])], 1) for kept in (total, weight, self.count + 1)
        )
        return total[:, 0] / weight[:, 0, None]

    def memory(self) -> dict[str, Tensor]:
        """What is carried from frame to frame."""
        return {"ensemble.total": self.total, "ensemble.weight": self.weight, "ensemble.count": self.count}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        self.total, self.weight, self.count = (memory[f"ensemble.{name}"] for name in ("total", "weight", "count"))


class VisionPolicy:
    """A learner in its closed loop: sees, knows its goal if it was taught to, and carries out the first of the actions
    that it predicts, or as many as it is made for, before it predicts again; or the mean of all that it has predicted.
    """

    def __init__(self, learner: Learner, goal: KnownGoal | None = None, gains: str = "improved") -> None:
        """`gains` are those of the tracker whose demonstrations it cloned."""
        self.gains = gains
        self.learner = learner.eval()
        self.senses = Senses(learner.inputs, goal)
        self.observations: tuple[str, ...] = self.senses.observations
        self._plan = torch.zeros(0, 0, 0)
        self._done = torch.zeros(0, dtype=torch.long)
        self._ensemble = Ensemble() if learner.ensembles else None

    def to(self, device: str) -> None:
        """Move the networks to a device."""
        self.learner.to(device)
        self.senses.to(device)
        self._plan, self._done = self._plan[:0].to(device), self._done[:0].to(device)
        self._ensemble = Ensemble() if self._ensemble else None

    @torch.no_grad()
    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Find out about the goal, and remember it; forget what was planned."""
        self.senses.begin(ids, obs)
        if len(self._done) != obs.num_envs:
            proprio = obs["proprio"]
            self._plan = proprio.new_zeros(obs.num_envs, self.learner.executes, self.learner.config.action_size)
            self._done = torch.zeros(obs.num_envs, dtype=torch.long, device=proprio.device)
        self._done = self._done.index_fill(0, ids, self.learner.executes)
        if self._ensemble:
            config = self.learner.config
            self._ensemble.begin(ids, obs.num_envs, obs["proprio"].new_empty(config.chunk, config.action_size))

    @torch.no_grad()
    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad]."""
        vector, maps = self.senses.see(obs)
        joints = self.learner.config.action_size
        joint_pos = obs["proprio"][:, -2 * joints : -joints]
        if self.learner.executes == 1:
            chunk = self._predicted(vector, maps, joint_pos)
            return self._ensemble.mean(chunk) if self._ensemble else chunk[:, 0]
        # robots that began at different times predict at different times
        due = self._done == self.learner.executes
        if torch.compiler.is_compiling():  # a graph cannot choose among them
            self._plan = torch.where(due[:, None, None], self._predicted(vector, maps, joint_pos), self._plan)
        elif due.any():
            found = self._predicted(vector[due], None if maps is None else maps[due], joint_pos[due])
            self._plan = self._plan.index_copy(0, due.nonzero()[:, 0], found)
        self._done = torch.where(due, 0, self._done)
        target = self._plan[torch.arange(len(self._done), device=self._done.device), self._done]
        self._done = self._done + 1
        return target

    def _predicted(self, vector: Tensor, maps: Tensor | None, joint_pos: Tensor) -> Tensor:
        """(n, K, J) joint targets [rad] from now on: those that are carried out, or all that there are of an ensemble.

        `joint_pos` (n, J) are the angles of the joints now.
        """
        chunk = self.learner.plan(vector, maps)
        chunk = chunk if self._ensemble else chunk[:, : self.learner.executes]
        return chunk + joint_pos[:, None] if self.learner.config.relative else chunk

    def networks(self) -> list[nn.Module]:
        """All that it runs on."""
        return [self.learner, *self.senses.networks()]

    def memory(self) -> dict[str, Tensor]:
        """(N, ...) what is carried from frame to frame, by name."""
        plan = {} if self.learner.executes == 1 else {"plan": self._plan, "done": self._done}
        return {**self.senses.memory(), **plan, **(self._ensemble.memory() if self._ensemble else {})}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        self.senses.remember(memory)
        self._plan, self._done = memory.get("plan", self._plan), memory.get("done", self._done)
        if self._ensemble:
            self._ensemble.remember(memory)
