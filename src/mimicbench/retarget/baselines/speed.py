"""How fast retargeting is, beside the paper's Adam and a per-frame inverse kinematics in the same run."""

import resource
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np

from mimicbench.core.errors import MimicbenchError
from mimicbench.retarget.baselines.adam import EPOCHS, RATE, adam
from mimicbench.retarget.baselines.mink_ik import solve_frames
from mimicbench.retarget.clip import Clip, storable
from mimicbench.retarget.kinematics import Pose, tree_of
from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.method import Method
from mimicbench.retarget.methods.copy_rotation import copy_rotations
from mimicbench.retarget.methods.optimization import PAPER, Problem, make_problem
from mimicbench.retarget.registry import METHODS
from mimicbench.retarget.solver import solve


@dataclass(frozen=True)
class RetargetBenchConfig:
    """What is measured."""

    epochs: int = EPOCHS
    """Of Adam."""
    frames: int = 120
    """Of one clip, in its middle, that Adam and mink get."""
    repetitions: int = 3
    """The best time of so many counts, so that other work on the machine does not."""


def frames_per_second(clips: Sequence[Clip], method: Method, preset: Preset | None = None) -> float:
    """Frames of these clips retargeted per second of processor time, everything included.

    The first clip is done once more before, unmeasured.
    """
    used = method.preset(preset)
    method.retarget(clips[0], used)
    start = process_time()
    for clip in clips:
        method.retarget(clip, used)
    return sum(clip.motion.frames for clip in clips) / (process_time() - start)


def bench_retargeting(
    clips: Mapping[str, Sequence[Clip]],
    paper_frames: Mapping[str, float],
    config: RetargetBenchConfig,
    say: Callable[[str], None],
) -> dict[str, object]:
    """Measure every method, Adam and mink on one core.

    Args:
        clips: Task -> some of its clips.
        paper_frames: Task -> frames of all clips that the paper has of it.
        config: What else.
        say: Hears of the progress.

    Returns:
        Processor time throughout, so other work on the machine hardly matters.
        frames_per_second: method -> task -> frames per second of a core, and `all`; two_core_hours: method -> hours
            that two cores need for the
        paper's clips; adam: its epochs, frames, frames_per_second, and true losses of the paper's objective reached by
        the solver and by Adam at the appendix's constant rate and at one that falls to 0; mink: frames_per_second,
        programs per frame and mean distance of the followed points [m] beside the solver's, or why it was left out;
        ratios: how many times as fast the solver is as each;
        memory_growth_mb: how much
        larger the process became over a second round of all clips.
    """
    speeds = {
        name: {task: _best(config.repetitions, of_task, METHODS.get(name)) for task, of_task in clips.items()}
        for name in METHODS
        if say(f"measuring {name}") is None
    }
    before = _peak()
    for of_task in clips.values():
        for clip in of_task:
            METHODS.all()[-1].retarget(clip, "improved")
    growth = _peak() - before
    hours = {
        name: sum(paper_frames[task] / rate for task, rate in by_task.items()) / 2 / 3600
        for name, by_task in speeds.items()
    }
    frames = {task: sum(clip.motion.frames for clip in of_task) for task, of_task in clips.items()}
    told = {
        name: {**by_task, "all": sum(frames.values()) / sum(frames[task] / rate for task, rate in by_task.items())}
        for name, by_task in speeds.items()
    }
    say(f"measuring Adam over {config.epochs} epochs")
    problem, start, clip = _example(next(iter(clips.values()))[0], config.frames)
    ours, solver_speed, solver_loss = _solved(problem, start, config.repetitions)
    adam_found, mink_found = _adam(problem, start, config.epochs, solver_loss), _mink(problem, start, clip, ours)
    ratios = {"solver_over_adam": solver_speed / adam_found["frames_per_second"]}
    if "frames_per_second" in mink_found:
        ratios["solver_over_mink"] = solver_speed / mink_found["frames_per_second"]
    return {
        "frames_per_second": told,
        "two_core_hours": hours,
        "solver_frames_per_second": solver_speed,
        "adam": adam_found,
        "mink": mink_found,
        "ratios": ratios,
        "memory_growth_mb": growth,
    }


def _mink(problem: Problem, start: Pose, clip: Clip, ours: Pose) -> dict[str, Any]:
    """The per-frame inverse kinematics on the same frames, or why it was left out."""
    began = process_time()
    try:
        pose, programs = solve_frames(problem, clip.robot, start)
    except MimicbenchError as error:
        return {"left_out": str(error)}
    return {
        "frames_per_second": len(start.joints) / (process_time() - began),
        "programs_per_frame": programs,
        "position_error": _followed(problem, pose),
        "solver_position_error": _followed(problem, ours),
    }


def _best(repetitions: int, clips: Sequence[Clip], method: Method) -> float:
    return max(frames_per_second(clips, method) for _ in range(repetitions))


def _example(clip: Clip, frames: int) -> tuple[Problem, Pose, Clip]:
    """The paper's objective of the frames in the middle of a clip, and a start."""
    motion = clip.motion
    first = max(0, (motion.frames - frames) // 2)
    middle = slice(first, first + frames)
    pos_w, quat_w = motion.forward_kinematics()
    bound, tree, limits = clip.bind("paper"), tree_of(clip.robot), storable(clip.robot.joint_range)
    problem = make_problem(bound, tree, limits, pos_w[middle], quat_w[middle], motion.fps, PAPER, clip.by_hand)
    return problem, copy_rotations(bound, tree, limits, pos_w[middle], quat_w[middle]), clip


def _solved(problem: Problem, start: Pose, repetitions: int) -> tuple[Pose, float, float]:
    """Configurations, frames per second and true loss of the solver, at the default tolerance."""
    times, pose = [], start
    for _ in range(repetitions):
        began = process_time()
        pose, _ = solve(problem, start, PAPER.iterations, PAPER.tolerance)
        times.append(process_time() - began)
    return pose, len(start.joints) / min(times), problem.loss(pose, problem.tree.place(pose), softened=False)


def _adam(problem: Problem, start: Pose, epochs: int, solver_loss: float) -> dict[str, float]:
    found: dict[str, float] = {"epochs": epochs, "rate": RATE, "frames": len(start.joints), "solver_loss": solver_loss}
    for name, falling in (("loss", False), ("falling_rate_loss", True)):
        began = process_time()
        pose, _ = adam(problem, start, epochs, falling=falling)
        found["frames_per_second"] = len(start.joints) / (process_time() - began)
        found[name] = problem.loss(pose, problem.tree.place(pose), softened=False)
    # the loss of a solver that goes on until nothing changes, on nearly true absolute values
    sharp = replace(problem, softness=1e-3, acceleration_softness=0.1 * problem.acceleration_softness)
    pose, _ = solve(sharp, start, 100, 1e-7)
    found["solver_converged_loss"] = problem.loss(pose, problem.tree.place(pose), softened=False)
    return found


def _followed(problem: Problem, pose: Pose) -> float:
    """Mean distance of the followed links from their targets [m]."""
    links = problem.tree.place(pose)
    pairs = len(problem.point_links) - problem.soles
    origin = [column for column in range(pairs) if not problem.point_offsets[column].any()]
    return float(
        np.linalg.norm(links.pos[:, problem.point_links[origin]] - problem.point_targets[:, origin], axis=-1).mean()
    )


def _peak() -> float:
    """Most memory that this process ever had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
