"""`mimicbench export policy`: a policy as a file that other programs can run."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import tyro

from mimicbench.commands.options import Json
from mimicbench.commands.telling import tell
from mimicbench.core.errors import MimicbenchError
from mimicbench.tasks.registry import DEFAULT_TASK


def export_policy(
    policy: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(help="folder of the policy's checkpoint")],
    out: Annotated[Path | None, tyro.conf.arg(help="the file; by default <folder's name>.onnx here")] = None,
    task: Annotated[
        str | None, tyro.conf.arg(help="the task; by default the one it was learned at, or the first of them")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a policy as an ONNX file with all that it needs, and see that both decide the same."""
    from mimicbench.core.checkpoint import checkpoint_robot, checkpoint_tasks
    from mimicbench.policies import export as exporting
    from mimicbench.robots.registry import ROBOTS
    from mimicbench.tasks.registry import TASKS

    policy = Path(os.path.abspath(policy))  # `.` has no name, and nothing beside it
    path = out or Path(f"{policy.name}.onnx")
    if path.suffix != ".onnx":
        raise MimicbenchError(f"--out is {str(path)!r}; give a name that ends in .onnx")
    robot, at = ROBOTS.get(checkpoint_robot(policy)), task or next(iter(checkpoint_tasks(policy)), DEFAULT_TASK)
    found = exporting.export_policy(policy, robot, TASKS.get(at), path)
    tell([found], as_json, f"{path}: {found['bytes'] / 1e6:.1f} MB, as the policy to {found['difference']:.1e} rad")
