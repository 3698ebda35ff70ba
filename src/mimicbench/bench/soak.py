"""Whether the world holds out: every object compiles, and millions of random control steps end as they should.

Nothing here is judged by how the robots do. What counts is that no step raises, that no number that is not finite goes
unreported, that memory does not grow, and that any number of threads comes to the same bits.
"""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from mujoco.batch import Batch

from mimicbench.bench.memory import resident_bytes
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.seeds import rng
from mimicbench.envs.gym_vector import TaskVectorEnv
from mimicbench.envs.spaces import action_space
from mimicbench.objects.registry import FAMILIES
from mimicbench.references.paper import PAPER_SETS
from mimicbench.robots.description import Robot
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.sim.scene import build_model
from mimicbench.tasks.registry import TASKS

PAPER_COUNTS = {TASKS.get(task).family: paper.objects for task, paper in PAPER_SETS.items()}
"""Objects of each family in the paper's table: 10.6 thousand."""
OTHERS = 400
"""Objects of families that are not in the paper."""
CONTROLS = ("position", "torque")


@dataclass(frozen=True)
class SoakConfig:
    """How long to go on."""

    steps: int = 10_000_000
    """Control steps, of all tasks and both kinds of control together."""
    envs: int = 256
    """Environments at once."""
    episode: float = 5.0
    """Length of an episode [s]; each has another object."""
    threads: tuple[int, ...] = (1, 2)
    """Do all of it once with each of these numbers of threads."""
    objects: int | None = None
    """Objects of each family to compile and meet; None: as many as the paper has."""
    seed: int = 0
    """Of objects, starts and targets."""


@dataclass(frozen=True)
class CompiledFamily:
    """What compiling a family came to."""

    family: str
    count: int
    failed: tuple[str, ...]
    """Ids of objects that could not be made, or not be compiled, or do not share a batch with the others."""
    seconds: float
    """On one core."""


@dataclass(frozen=True)
class SoakedTask:
    """What the steps of one task came to."""

    task: str
    control: str
    steps: int
    """Control steps."""
    episodes: int
    """Episodes that began."""
    objects: int
    """Different objects that were met."""
    reported: int
    """Scenes that broke and were reported."""
    unreported: int
    """Scenes whose state was not finite without a report: there must be none."""
    hash: str
    """Of all positions and velocities, taken every 50 steps and at the end."""
    seconds: float
    grown_mb: float
    """Resident memory at the end above that after the first fifth of the steps [MB]."""


def soak(config: SoakConfig, say: Callable[[str], None]) -> dict[str, Any]:
    """Compile every object, then step; everything as plain JSON values.

    `sound` sums up whether all is as it should be.
    """
    robot = ROBOTS.get(DEFAULT_ROBOT)
    compiled = [
        compile_family(robot, family, _count(family, config), config.seed, say)
        for family in dict.fromkeys(task.family for task in TASKS.all())
    ]
    steps = max(1, config.steps // (len(TASKS) * len(CONTROLS)))
    parts = {
        threads: [soak_task(task, control, steps, threads, config, say) for task in TASKS for control in CONTROLS]
        for threads in config.threads
    }
    hashes = {
        threads: hashlib.sha256("".join(part.hash for part in found).encode()).hexdigest()
        for threads, found in parts.items()
    }
    every = [part for found in parts.values() for part in found]
    sound = (
        len(set(hashes.values())) == 1
        and not any(part.unreported for part in every)
        and not any(family.failed for family in compiled)
    )
    say(f"{sum(part.steps for part in every)} control steps, hashes {hashes}: {'sound' if sound else 'NOT sound'}")
    return {
        "config": asdict(config),
        "sound": sound,
        "compiled": [asdict(family) for family in compiled],
        "hashes": {str(n): value for n, value in hashes.items()},
        "parts": {str(n): [asdict(part) for part in found] for n, found in parts.items()},
    }


def _count(family: str, config: SoakConfig) -> int:
    return config.objects or PAPER_COUNTS.get(family, OTHERS)


def compile_family(robot: Robot, family: str, count: int, seed: int, say: Callable[[str], None]) -> CompiledFamily:
    """Make objects 0 to count - 1 of a family, compile their scenes, and have one batch take each of them."""
    started = time.perf_counter()
    batch = Batch(build_model(robot, FAMILIES.get(family).make(0, seed)), 1, 1)
    failed = []
    for index in range(count):
        try:
            batch.set_models(build_model(robot, FAMILIES.get(family).make(index, seed)))
        except (MimicbenchError, ValueError) as error:  # MuJoCo says with ValueError what it cannot compile
            failed.append(f"{family}-{seed}-{index:05d}")
            say(f"{failed[-1]}: {error}")
    seconds = time.perf_counter() - started
    say(f"{count - len(failed)} of {count} objects of family {family} compiled in {seconds:.1f} s")
    return CompiledFamily(family, count, tuple(failed), seconds)


def soak_task(
    task: str, control: str, steps: int, threads: int, config: SoakConfig, say: Callable[[str], None]
) -> SoakedTask:
    """Step environments of a task with random targets, `steps` control steps in all, rounded up."""
    pool = _count(TASKS.get(task).family, config)
    envs = min(config.envs, steps)
    env = TaskVectorEnv(task, envs, split="all", pool=pool, control=control, time_limit=config.episode, workers=threads)
    env.reset(seed=config.seed)
    physics, digest, random = env.episodes.env.physics, hashlib.sha256(), rng(config.seed, "soak", task, control)
    space = action_space(env.episodes.robot, control, "target")
    low, high = space.low, space.high
    target = random.uniform(low, high, (envs, len(low))).astype(np.float32)
    rounds, episodes, unreported, met = -(-steps // envs), envs, 0, {start.obj.id for start in env.episodes.starts}
    settled, started = float("nan"), time.perf_counter()
    for step in range(rounds):
        fresh = random.random(envs) < 0.1  # targets stay for a fifth of a second on average
        target[fresh] = random.uniform(low, high, (int(fresh.sum()), len(low)))
        _, _, terminated, truncated, info = env.step(target)
        finite = np.isfinite(physics.qpos()).all(-1) & np.isfinite(physics.qvel()).all(-1)
        unreported += int((~finite & ~info["diverged"]).sum())
        episodes += int((terminated | truncated).sum())
        if step % 50 == 49 or step == rounds - 1:
            _add(digest, (physics.qpos(), physics.qvel()))
            met.update(start.obj.id for start in env.episodes.starts)
        if step == rounds // 5:
            settled = resident_bytes()
    found = SoakedTask(
        task,
        control,
        rounds * envs,
        episodes,
        len(met),
        physics.broken.count,
        unreported,
        digest.hexdigest(),
        time.perf_counter() - started,
        (resident_bytes() - settled) / 1e6,
    )
    env.close()
    say(
        f"{task}, {control} control, {threads} threads: {found.steps} control steps, {found.episodes} "
        f"episodes, {found.objects} objects, "
        f"{found.reported} reported, {found.unreported} unreported, {found.seconds:.0f} s, memory "
        f"{found.grown_mb:+.1f} MB, {found.hash[:12]}"
    )
    return found


def _add(digest: "hashlib._Hash", arrays: Sequence[np.ndarray]) -> None:
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
