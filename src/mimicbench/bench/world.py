"""How fast environments are, beside bare physics in the same run.

Environments and bare physics take turns on the same simulation, a quarter of a second each: the same models, the same
random targets, the robots in the same states, the machine under the same load. A ratio is the median over the turns,
and holds on a busy machine too, which the rates do not. The episodes are of all ages, so that as many end and begin in
each step as in a long run.
"""

import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from mimicbench.bench.memory import resident_bytes
from mimicbench.bench.sensors import bench_senses
from mimicbench.core.seeds import rng
from mimicbench.envs.gym_vector import TaskVectorEnv
from mimicbench.objects.registry import FAMILIES
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.tasks.registry import DEFAULT_TASK, TASKS

WITHOUT_MAP = ("proprio", "state", "time")
_TURN = 0.25
"""[s] each side steps before it is the other's turn."""
_TARGETS = 16
"""Sets of random targets, drawn beforehand."""


@dataclass(frozen=True)
class WorldBenchConfig:
    """What to measure."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """Whose environments."""
    sizes: tuple[int, ...] = (64, 512, 4096)
    """How many environments at once."""
    seconds: float = 4.0
    """How long each figure is measured [s]; three turns at least."""
    maps: bool = True
    """Measure with the elevation map too; 4096 robots need some seconds for each look."""
    memory: bool = True
    """Measure memory, each time in a process of its own."""
    pool: int = 48
    """Objects to meet. They are compiled beforehand, as in a long run."""
    workers: int = 0
    """Threads; 0 for all processors."""
    device: str = "cpu"
    """What computes the physics."""


@dataclass(frozen=True)
class WorldRow:
    """One task at one size."""

    task: str
    envs: int
    bare: float
    """Control steps per second, all environments together, of bare stepping (`Physics.advance`)."""
    env: float
    """The same of the environments: goals, K and P, observations, resets."""
    ratio: float
    """env / bare, the median over the turns."""
    env_map: float | None
    """Control steps per second of the environments with the elevation map; None if it was not measured."""
    ratio_map: float | None


@dataclass(frozen=True)
class MemoryRow:
    """Resident memory of environments of one size."""

    envs: int
    mb_per_env: float
    """[MB] What making, resetting and stepping them adds to the process, shared out; None of it is Python's or MuJoCo's
    own."""
    mb_per_env_map: float | None
    """The same with the elevation map."""


def bench_world(config: WorldBenchConfig, say: Callable[[str], None]) -> dict[str, Any]:
    """Measure environments of all tasks and sizes, memory, and the senses; everything as plain JSON values."""
    rows = [bench_task(task, envs, config, say) for task in config.tasks for envs in config.sizes]
    memory = [_memory_row(config.tasks[0], envs, config, say) for envs in config.sizes] if config.memory else []
    senses = bench_senses(
        ROBOTS.get(DEFAULT_ROBOT),
        [FAMILIES.get(TASKS.get(DEFAULT_TASK).family).make(index, 0) for index in range(16)],
        config.seconds / 4,
        device=config.device,
    )
    say(", ".join(f"{name} {value:.3g}" for name, value in senses.items()))
    return {
        "config": asdict(config),
        "rows": [asdict(row) for row in rows],
        "memory": [asdict(row) for row in memory],
        "senses": senses,
    }


def bench_task(task: str, envs: int, config: WorldBenchConfig, say: Callable[[str], None]) -> WorldRow:
    """Measure one task at one size."""
    env, bare, ratio = _take_turns(task, envs, WITHOUT_MAP, config)
    say(f"{task}, {envs} environments: {env:.0f} of bare physics' {bare:.0f} control steps per second, {ratio:.0%}")
    env_map = ratio_map = None
    if config.maps:
        env_map, _, ratio_map = _take_turns(task, envs, (*WITHOUT_MAP, "elevation"), config)
        say(f"    with the elevation map {env_map:.0f}, {ratio_map:.1%}")
    return WorldRow(task, envs, bare, env, ratio, env_map, ratio_map)


def _take_turns(task: str, envs: int, observe: Sequence[str], config: WorldBenchConfig) -> tuple[float, float, float]:
    """Control steps per second of environments, of bare physics, and the ratio."""
    env, targets = _make(task, envs, observe, config)
    physics = env.episodes.env.physics
    on_device = torch.from_numpy(targets).to(physics.device)
    count = 0

    def step_env() -> None:
        nonlocal count
        env.step(targets[count % _TARGETS])
        count += 1

    def step_bare() -> None:
        nonlocal count
        physics.advance(on_device[count % _TARGETS])
        count += 1

    step_env()
    step_bare()
    rates: list[tuple[float, float]] = []
    started = time.perf_counter()
    while time.perf_counter() - started < config.seconds or len(rates) < 3:
        turns = {
            step: _rate(step, envs) for step in ((step_env, step_bare) if len(rates) % 2 else (step_bare, step_env))
        }
        rates.append((turns[step_env], turns[step_bare]))
    env.close()
    with_env, without = (float(np.median(column)) for column in zip(*rates, strict=True))
    return with_env, without, float(np.median([a / b for a, b in rates]))


def _make(task: str, envs: int, observe: Sequence[str], config: WorldBenchConfig) -> tuple[TaskVectorEnv, np.ndarray]:
    """Environments in the midst of their episodes, and targets for some steps (_TARGETS, N, J)."""
    env = TaskVectorEnv(
        task, envs, observe=observe, split="all", pool=config.pool, workers=config.workers, device=config.device
    )
    env.reset(seed=0)
    random = rng(0, "bench", "world", task)
    robot = env.episodes.robot
    rest, (low, high) = np.array(robot.rest_pose), robot.joint_range.T
    targets = np.clip(rest + random.uniform(-0.3, 0.3, (_TARGETS, envs, len(rest))), low, high).astype(np.float32)
    for step in range(_TARGETS):  # so that robots are in touch with something, and most objects compiled
        env.episodes.step(targets[step], np.ones(envs, bool))
    env.episodes.metrics.steps[:] = torch.from_numpy(random.integers(env.episodes.limit, size=envs))
    return env, targets


def _rate(step: Callable[[], None], envs: int) -> float:
    """Control steps per second of all environments together, over one turn."""
    rounds, started = 0, time.perf_counter()
    while time.perf_counter() - started < _TURN:
        step()
        rounds += 1
    return rounds * envs / (time.perf_counter() - started)


def _memory_row(task: str, envs: int, config: WorldBenchConfig, say: Callable[[str], None]) -> MemoryRow:
    senses = (WITHOUT_MAP, (*WITHOUT_MAP, "elevation")) if config.maps else (WITHOUT_MAP,)
    found = []
    for observe in senses:
        # a new process each: one that has held more before would have room to spare
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            found.append(pool.apply(memory_per_env, (task, envs, observe, config)) / 1e6)
    row = MemoryRow(envs, found[0], found[1] if len(found) > 1 else None)
    say(
        f"{envs} environments: {row.mb_per_env:.3f} MB each"
        + ("" if row.mb_per_env_map is None else f", with the elevation map {row.mb_per_env_map:.3f} MB")
    )
    return row


def memory_per_env(task: str, envs: int, observe: Sequence[str], config: WorldBenchConfig) -> float:
    """Bytes of resident memory that each of `envs` environments adds to this process."""
    warm, targets = _make(task, 1, observe, config)
    warm.step(targets[0])
    before = resident_bytes()
    env, targets = _make(task, envs, observe, config)
    seen = [env.step(targets[step]) for step in range(2)]
    after = resident_bytes()
    del seen
    return (after - before) / envs
