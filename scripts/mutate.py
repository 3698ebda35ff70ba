"""Change one line at a time of what numbers rest on, and see whether a test notices.

    python scripts/mutate.py                 the stated guarantees, then every operator of the decisive modules
    python scripts/mutate.py --guards        the guarantees alone
    python scripts/mutate.py --module core/stage.py --most 40

Each change is made in a copy of the sources; the tests run on the copy. A survivor is a change that no test notices: it
is printed as `module:line: before -> after`. The exit status is 1 if a guarantee survives; of the operators the list is
what counts, for some changes change nothing (a longer message, a faster path).
"""

import argparse
import ast
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = Path("src/mimicbench")
SECONDS = 300
"""[s] of the processor. A change that makes the tests work longer has been noticed."""
WAIT = 3600.0
"""[s] by the clock, however busy the machine is: so has one that makes them wait."""


@dataclass(frozen=True)
class Change:
    """One line, changed."""

    module: str
    """In the package."""
    before: str
    after: str
    tests: str
    """What should notice: arguments of pytest."""
    line: int = 0
    """Where; 0: wherever `before` is, once."""


GUARDS = (
    Change(
        "benchmark/judging.py",
        "set=clips.split(run.recipe.evaluate.split)",
        "set=clips.set",
        "tests/test_guards.py -k episodes_are_on",
    ),
    Change(
        "benchmark/judging.py", "test_only=True", "test_only=False", "tests/test_guards.py -k clips_for_an_evaluation"
    ),
    Change(
        "envs/clips.py",
        'clips.split("train"), clips.split("test")',
        'clips, clips.split("test")',
        "tests/test_guards.py -k trackers_learn",
    ),
    Change(
        "imitate/demos.py",
        "if not (verdict.success[i] and verdict.stays[i]):",
        "if not verdict.stays[i]:",
        "tests/test_guards.py -k demonstrations_are",
    ),
    Change(
        "imitate/demos.py",
        "if not (verdict.success[i] and verdict.stays[i]):",
        "if not verdict.success[i]:",
        "tests/test_guards.py -k demonstrations_are",
    ),
    Change(
        "imitate/demos.py",
        "motions[first:end]), first < clean)",
        "motions[first:end]), first <= clean)",
        "tests/test_guards.py -k share",
    ),
    Change(
        "imitate/lerobot.py", 'if row["success"] or not only_success', "if True", "tests/test_lerobot.py -k round_trip"
    ),
    Change(
        "imitate/stored/sampler.py",
        "return _some(self.frames, count, generator)",
        "return _some(torch.arange(self._demos.frames), count, generator)",
        "tests/test_imitate.py -k that_judge",
    ),
    Change(
        "imitate/dataset.py",
        "torch.nonzero(~held)",
        "torch.nonzero(held | ~held)",
        "tests/test_imitate.py -k that_judge",
    ),
    Change("benchmark/judging.py", '"clips": clips.stage.digest,', "", "tests/test_guards.py -k rows_follow"),
    Change("benchmark/judging.py", "**who.digests,", "", "tests/test_recipe.py -k rows_say"),
    Change(
        "envs/metrics.py",
        "(self.run, self.steps, self.max_effort, self.fell_phase)",
        "(self.run, self.steps, self.fell_phase)",
        "tests/test_metrics.py -k forgets",
    ),
    Change(
        "track/tracking.py",
        "dropped = ref.root_pos_w[:, 2] - state.root_pos_w[:, 2] > ends.max_drop",
        "dropped = torch.zeros_like(far)",
        "tests/test_tracking_env.py -k sinks",
    ),
    Change(
        "track/tracking.py",
        "return failed | time_out, time_out & ~failed",
        "return failed | time_out, time_out",
        "tests/test_tracking_env.py -k who_fails",
    ),
    Change(
        "references/checks/quality.py",
        "elif not measures[name] <= (limit if original",
        "elif measures[name] > (limit if original",
        "tests/test_guards.py -k gate",
    ),
    Change(
        "retarget/acceptance.py",
        "if not all(math.isfinite(value) for value in measures.values()):",
        "if False:",
        "tests/test_retarget_methods.py -k by_hand",
    ),
)
"""What the documents promise, and the change that would break it."""
DECISIVE = {
    "evaluate/intervals.py": "tests/test_evaluate_rows.py",
    "evaluate/rows.py": "tests/test_evaluate_rows.py",
    "retarget/acceptance.py": "tests/test_retarget_methods.py tests/test_guards.py "
    "-k verdict_by_hand or limits_of_solved or rates_of_a_set",
    "core/stage.py": "tests/test_stage.py",
    "envs/metrics.py": "tests/test_metrics.py tests/test_tasks.py",
    "evaluate/rollout.py": "tests/test_episode_rows.py",
    "track/tracking.py": "tests/test_tracking_env.py tests/test_assist.py",
    "track/failures.py": "tests/test_tracking_env.py -k failure",
    "track/trackers/residual.py": "tests/test_tracker_rewards.py -k reward or actions_mean or next_pose or one_arm",
    "track/trackers/hst.py": "tests/test_tracker_rewards.py -k reward or actions_mean or next_pose",
}
"""Small modules on which every number rests, and their tests."""
SLOW = (
    "numpy",
    "scipy.spatial",
    "torch",
    "mujoco",
    "pyarrow.parquet",
    "gymnasium",
    "hypothesis",
    "msgspec",
    "safetensors",
)
"""What the package and its tests import of others: once, before any change is tried."""
_OPERATORS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==", ast.Add: "-", ast.Sub: "+",
    ast.Mult: "/", ast.Div: "*", ast.And: "or", ast.Or: "and", ast.BitAnd: "|", ast.BitOr: "&",
}  # fmt: skip


def operators(module: str, tests: str) -> Iterator[Change]:
    """Every line of a module with one operator, number or truth value changed."""
    source = (ROOT / PACKAGE / module).read_text()
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        for place, before, after in _swaps(node, source):
            line = lines[place.lineno - 1]
            changed = line[: place.col_offset] + after + line[place.col_offset + len(before) :]
            yield Change(module, line, changed, tests, place.lineno)


@dataclass(frozen=True)
class _Place:
    lineno: int
    col_offset: int


def _swaps(node: ast.AST, source: str) -> Iterator[tuple[_Place, str, str]]:
    """Where a node has something to change, what it is, and what it becomes; only what is on one line."""
    pairs: list[tuple[ast.expr, ast.AST, ast.expr]] = []
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        pairs = [(node.left, node.ops[0], node.comparators[0])]
    elif isinstance(node, ast.BinOp):
        pairs = [(node.left, node.op, node.right)]
    elif isinstance(node, ast.BoolOp):
        pairs = [(left, node.op, right) for left, right in zip(node.values, node.values[1:], strict=False)]
    for left, operator, right in pairs:
        wanted = _OPERATORS.get(type(operator))
        if wanted is None or left.end_lineno != right.lineno or left.end_col_offset is None:
            continue
        between = source.splitlines()[right.lineno - 1][left.end_col_offset : right.col_offset]
        symbol = between.strip(" ()")
        if symbol:
            yield _Place(right.lineno, left.end_col_offset + between.index(symbol)), symbol, wanted
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        if source.splitlines()[node.lineno - 1].lstrip().startswith("@dataclass"):
            return
        yield _Place(node.lineno, node.col_offset), str(node.value), str(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        text = ast.get_source_segment(source, node) or str(node.value)
        yield _Place(node.lineno, node.col_offset), text, f"({text} + 1)"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert):
        yield _Place(node.lineno, node.col_offset), "not" if isinstance(node.op, ast.Not) else "~", ""


def survives(change: Change, copy: Path) -> bool:
    """Whether the tests pass on a copy of the sources with that change."""
    path = copy / PACKAGE / change.module
    source = path.read_text()
    if change.line:
        lines = source.splitlines(keepends=True)
        lines[change.line - 1] = change.after + "\n"
        changed = "".join(lines)
    else:
        if source.count(change.before) != 1:
            raise SystemExit(f"{change.module} has not one {change.before!r}: the list of guards is out of date")
        changed = source.replace(change.before, change.after)
    path.write_text(changed)
    try:
        return _passes(change.tests, copy)
    finally:
        path.write_text(source)


def _passes(tests: str, copy: Path) -> bool:
    """Whether the tests pass on the copy, in a process forked from this one, which has imported what takes long."""
    process = os.fork()
    if not process:
        os.setsid()
        os.environ |= {"PYTHONPATH": str(copy / "src"), "OMP_NUM_THREADS": "1"}
        os.chdir(copy)
        sys.path[:0] = [str(copy / "src"), str(copy / "scripts")]
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        sys.dont_write_bytecode = True
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        status = 1
        try:
            status = int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *_words(tests)]))
        finally:
            os._exit(status)
    ends = time.monotonic() + WAIT
    while time.monotonic() < ends:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return status == 0
        time.sleep(0.05)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return False


def _words(tests: str) -> list[str]:
    paths, _, chosen = tests.partition(" -k ")
    return [*paths.split(), *(["-k", chosen] if chosen else [])]


def together(tests: Sequence[str]) -> str:
    """Arguments of pytest for all of them at once: what several start from is then made once."""
    paths, chosen = zip(*((paths, names) for paths, _, names in (one.partition(" -k ") for one in tests)), strict=True)
    files = " ".join(dict.fromkeys(" ".join(paths).split()))
    return f"{files} -k {' or '.join(dict.fromkeys(chosen))}" if all(chosen) else files


def run(changes: list[Change], copy: Path, title: str) -> list[Change]:
    """Try the changes, and print those that survive."""
    print(f"{title}: {len(changes)} changes", flush=True)
    found = []
    if not _passes(together([change.tests for change in changes]), copy):
        raise SystemExit(f"the tests of {title} fail without any change; mend that first")
    for change in changes:
        if survives(change, copy):
            found.append(change)
            said = f"{change.before.strip()} -> {change.after.strip()}"
            print(f"  survives  {change.module}:{change.line}: {said}", flush=True)
    print(f"  {len(found)} of {len(changes)} survive", flush=True)
    return found


def main() -> int:
    """0 if no guarantee survives."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--guards", action="store_true", help="the guarantees alone")
    parser.add_argument("--module", choices=DECISIVE, help="the operators of one module alone")
    parser.add_argument("--most", type=int, default=0, help="try so many operators of a module, drawn at random")
    chosen = parser.parse_args()
    for name in SLOW:
        import_module(name)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in ("src", "tests", "docs", "examples", "scripts", "pyproject.toml", "README.md"):
            source = ROOT / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, copy / name)
        lost = [] if chosen.module else run(list(GUARDS), copy, "guarantees")
        for module, tests in {} if chosen.guards else DECISIVE.items():
            if chosen.module in (None, module):
                changes = list(operators(module, tests))
                if chosen.most:
                    changes = random.Random(0).sample(changes, min(chosen.most, len(changes)))
                run(changes, copy, module)
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
