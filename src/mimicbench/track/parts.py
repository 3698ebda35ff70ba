"""Several tracking environments as one: robots of one or more tasks, in parts that are stepped beside each other.

While one part works out observations and rewards in Python, the physics of another uses the processor, so more than
one part also pays for a single task. What happens in a part does not depend on the others, nor on the threads.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import accumulate
from typing import TypeVar

import torch
from torch import Tensor

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.parallel import cpu_count
from mimicbench.core.seeds import digest
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.track.settings import TrackingConfig
from mimicbench.track.spec import TrackerSpec
from mimicbench.track.tracker import Layout
from mimicbench.track.tracking import TrackingEnv

_T = TypeVar("_T")


class TrackingParts:
    """N robots in P tracking environments, laid one after the other."""

    def __init__(
        self,
        spec: TrackerSpec,
        sets: Sequence[ClipSet],
        robots: Sequence[int],
        parts: int,
        config: TrackingConfig,
        seed: int,
        env_config: EnvConfig | None = None,
        frames: int = 0,
    ) -> None:
        """`robots` of each set of clips, split over at least `parts` environments, as many for each set.

        `frames` are what a network sees at once; 0: as many as the design says.
        """
        env_config = env_config or EnvConfig()
        self.layout = Layout.of(spec, sets[0].robot, [clips.task for clips in sets], frames)
        copies = -(-max(parts, len(sets)) // len(sets))
        of_part = [clips for clips in sets for _ in range(copies)]
        shares = [len(range(copy, count, copies)) for count in robots for copy in range(copies)]
        if min(shares) < 1:
            raise MimicbenchError(
                f"{sum(robots)} robots are too few for {len(shares)} parts, of which each is to have one; give more "
                "(--track.num-envs), or fewer parts (--track.parts)"
            )
        threads = min(env_config.workers or cpu_count(), len(of_part)) if env_config.device == "cpu" else 1
        self._pool = ThreadPoolExecutor(threads, initializer=torch.set_num_threads, initargs=(1,))
        each = replace(env_config, workers=max(1, (env_config.workers or cpu_count()) // threads))
        self.parts = [
            TrackingEnv(spec, clips, share, config, digest(seed, "part", number) if number else seed, each, self.layout)
            for number, (clips, share) in enumerate(zip(of_part, shares, strict=True))
        ]
        self._shares = shares

    @property
    def device(self) -> str:
        """Where all tensors live."""
        return self.parts[0].device

    def places(self) -> list[tuple[str, slice]]:
        """The task of each part, and where its robots are among all."""
        ends = list(accumulate(self._shares))
        starts = (end - share for end, share in zip(ends, self._shares, strict=True))
        places = map(slice, starts, ends)
        return [(part.clips.task.name, place) for part, place in zip(self.parts, places, strict=True)]

    def observe(self) -> Tensor:
        """(N, F O) what the tracker observes now, after the frames before."""
        return torch.cat(self._each(TrackingEnv.observe))

    def step(self, action: Tensor, settings: object) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Apply actions (N, J) in all parts; see TrackingEnv.step."""
        actions = iter(action.split(self._shares))
        given = {id(part): next(actions) for part in self.parts}
        results = self._each(lambda part: part.step(given[id(part)], settings))
        obs, reward, done, time_out = (torch.cat(values) for values in zip(*results, strict=True))
        return obs, reward, done, time_out

    def ended(self) -> dict[str, Tensor]:
        """How many episodes of each task ended for each of `ends` since this was asked last."""
        found: dict[str, Tensor] = {}
        for part in self.parts:
            name = part.clips.task.name
            found[name] = found.get(name, 0) + part.ended
            part.ended = torch.zeros_like(part.ended)
        return found

    @property
    def ends(self) -> tuple[str, ...]:
        """Why episodes end, in words."""
        return self.parts[0].ends

    def state_tensors(self) -> dict[str, Tensor]:
        """All that decides how the episodes go on, between steps."""
        return {
            f"{number}/{name}": value
            for number, part in enumerate(self.parts)
            for name, value in part.state_tensors().items()
        }

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`, in parts made alike."""
        for number, part in enumerate(self.parts):
            prefix = f"{number}/"
            part.load_state_tensors({n.removeprefix(prefix): v for n, v in tensors.items() if n.startswith(prefix)})

    def close(self) -> None:
        """Give everything back."""
        self._pool.shutdown()
        for part in self.parts:
            part.env.close()

    def _each(self, function: Callable[[TrackingEnv], _T]) -> list[_T]:
        """Call a function on every part, several at a time; the largest first, so that none waits long for the last."""
        order = sorted(range(len(self.parts)), key=lambda number: -self._shares[number])
        waiting = {number: self._pool.submit(function, self.parts[number]) for number in order}
        return [waiting[number].result() for number in range(len(self.parts))]
