"""A command for each stage of a recipe: `mimicbench objects`, `references`, `retarget`, `track`, `demos`, `imitate`."""

from __future__ import annotations

from collections.abc import Sequence

from mimicbench.commands.parsing import Call, read_call
from mimicbench.commands.telling import stage_line, stage_summary, tell


def objects(argv: Sequence[str]) -> None:
    """Make the objects of a task, or of all tasks."""
    _make("objects", argv)


def references(argv: Sequence[str]) -> None:
    """Make good human clips on the objects."""
    _make("references", argv)


def track(argv: Sequence[str]) -> None:
    """Train a tracker on the retargeted clips."""
    _make("track", argv)


def demos(argv: Sequence[str]) -> None:
    """Let the tracker turn the training clips into demonstrations (a LeRobotDataset v3)."""
    _make("demos", argv)


def verify(argv: Sequence[str]) -> None:
    """Replay the states of stored demonstrations, and say in how many K is fulfilled and kept to the end."""
    call = read_call("demos", argv)
    from mimicbench.benchmark.graph import start
    from mimicbench.benchmark.verifying import verify_demos
    from mimicbench.core.errors import MimicbenchError

    runs = [start(recipe, call.options.workdir, call.options.context()) for recipe in call.recipes]
    found = [verify_demos(run) for run in runs]
    told = [f"{one['task']}: {one['fulfilled']} of {one['demonstrations']} fulfil K and stay" for one in found]
    tell(found, call.options.json, "\n".join(told))
    wrong = [name for one in found for name in one["wrong"]]
    if wrong:
        raise MimicbenchError(f"{len(wrong)} demonstrations do not show what they should: {', '.join(wrong[:8])}")


def imitate(argv: Sequence[str]) -> None:
    """Learn a policy that sees."""
    _make("imitate", argv)


def retarget(argv: Sequence[str]) -> None:
    """Turn the human clips into robot clips, and keep those that are solved and fulfil the task's metric."""
    call = read_call("retarget", argv)
    from mimicbench.benchmark import run_stage
    from mimicbench.report.retargeting import measures_table
    from mimicbench.report.table import to_terminal

    stages = [run_stage("retarget", recipe, call.options.workdir, call.options.context()) for recipe in call.recipes]
    lines = []
    for stage in stages:
        told = stage.summary
        wrong = ", ".join(f"{name} {count}" for name, count in told["rejected_for"].items())
        lines += [
            f"retarget: {told['clips']} clips, {told['fulfilled']} fulfil K, {100 * told['rate']:.1f} % kept"
            f"{'; kept out for ' + wrong if wrong else ''} ({stage.folder})",
            to_terminal(measures_table(stage.header["task"], told["measures"])),
        ]
    found = [{**stage_summary(stage), **stage.header["settings"]} for stage in stages]
    tell(found, call.options.json, "\n".join(lines))


def _make(stage: str, argv: Sequence[str]) -> None:
    from mimicbench.benchmark import run_stage

    call: Call = read_call(stage, argv)
    made = [run_stage(stage, recipe, call.options.workdir, call.options.context()) for recipe in call.recipes]
    tell([stage_summary(one) for one in made], call.options.json, "\n".join(stage_line(one) for one in made))
