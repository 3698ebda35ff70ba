"""Policies of ours as ONNX files (policies.onnx_file), checked against the originals."""

import logging
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Protocol, runtime_checkable

import torch
from torch import Tensor, nn

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import write_atomic
from mimicbench.envs.policy import Policy
from mimicbench.policies.loading import load_policy
from mimicbench.policies.onnx_file import MISSING, load_onnx
from mimicbench.policies.registry import LOADERS
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import TERMS, Observations
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task

OPSET = 20
TOLERANCE = 1e-3
"""[rad] by which targets may differ: sums round differently, and what is carried adds that up."""
FRAMES, ROBOTS, TICK = 12, 3, 0.25
"""Of the check: TICK [s] between frames, so that who looks again every second does."""


@runtime_checkable
class Remembers(Policy, Protocol):
    """A policy that can say what it carries from frame to frame, so that an ONNX file can do that, too."""

    def networks(self) -> list[nn.Module]:
        """All that it runs on."""
        ...

    def memory(self) -> dict[str, Tensor]:
        """(N, ...) by name, after `reset` or `act`."""
        ...

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        ...


def export_policy(folder: Path, robot: Robot, task: Task, path: Path) -> dict[str, Any]:
    """Write the policy of a checkpoint as an ONNX file, and tell by how much the two differ.

    Raises:
        MimicbenchError: What it needs is not installed, the policy cannot be told as a graph, or the file decides
            otherwise than the policy.
        BadFile: There is no policy in the folder.
    """
    try:
        import onnx
        import onnxruntime  # noqa: F401 for the check
        import onnxscript  # noqa: F401 torch's exporter needs it
    except ImportError as error:
        raise MimicbenchError(MISSING.format("this", error.name)) from None
    policy = load_policy(folder, robot, task)
    if not isinstance(policy, Remembers):
        raise MimicbenchError(
            f"{folder} holds a policy that does not say what it remembers, and so has no ONNX form; export one of "
            f"these kinds: {', '.join(loader.name for loader in LOADERS.all() if loader.exports)}"
        )
    policy.to("cpu")
    names = tuple(dict.fromkeys((*policy.observations, "time")))
    observed = _drawn(names, robot, task, 0, 1)
    policy.reset(torch.arange(1), observed)
    carried = policy.memory()
    graph = _Graph(policy, names, tuple(carried))
    values = (*(observed[name] for name in names), *carried.values())
    try:
        model = _translated(
            graph.eval(),
            values,
            [*names, *(f"{name}.before" for name in carried)],
            ["target", *(f"{name}.after" for name in carried)],
        )
    except Exception as error:  # noqa: BLE001 torch's exporter raises what it likes
        told = str(error).strip().partition("\n")[0]
        raise MimicbenchError(f"{folder} holds a policy that has no ONNX form ({told}); export another") from None
    told = {"robot": robot.name, "task": task.name, "gains": policy.gains, "observations": ",".join(names)}
    onnx.helper.set_model_props(model, {**told, **({"carried": ",".join(carried)} if carried else {})})
    data = model.SerializeToString()
    found: list[float] = []

    def write(stream: IO[bytes]) -> None:
        # checked before it takes the place of what may be there
        stream.write(data)
        stream.flush()
        found.append(_difference(policy, Path(stream.name), robot, task))
        if not found[0] < TOLERANCE:
            raise MimicbenchError(f"the ONNX of {folder} decides otherwise, by {found[0]:.3g} rad; it was not kept")

    write_atomic(path, write)
    return {"file": str(path), "bytes": len(data), "observations": list(names), "difference": found[0]}


def _translated(graph: nn.Module, values: tuple[Tensor, ...], inputs: list[str], outputs: list[str]) -> Any:
    """The ONNX model of a graph.

    Of torch's own optimization only what makes files smaller is done, and from where in which code an operation comes
    is left out. Rewriting patterns takes most of the exporter's time, and onnxruntime does so as it loads a file.
    """
    from onnx_ir.passes.common import ClearMetadataAndDocStringPass, CommonSubexpressionEliminationPass
    from onnxscript import optimizer

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        program = torch.onnx.export(
            graph,
            values,
            input_names=inputs,
            output_names=outputs,
            opset_version=OPSET,
            dynamo=True,
            optimize=False,
            verbose=False,
        )
    assert program is not None
    model: Any = program.model
    optimizer.inline(model)
    optimizer.fold_constants(model)
    CommonSubexpressionEliminationPass()(model)
    optimizer.remove_unused_nodes(model)
    ClearMetadataAndDocStringPass()(model)
    return program.model_proto


class _Graph(nn.Module):
    """One frame of a policy with one robot: terms and memory -> targets and memory. It begins anew where time is 0."""

    def __init__(self, policy: Remembers, names: tuple[str, ...], carried: tuple[str, ...]) -> None:
        super().__init__()
        self._policy, self._names, self._carried = policy, names, carried
        self.networks = nn.ModuleList(policy.networks())

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        """Run it."""
        obs = Observations(dict(zip(self._names, values, strict=False)))
        before = dict(zip(self._carried, values[len(self._names) :], strict=True))
        begins = obs["time"][:, 0] < 0.5 * CONTROL_DT
        self._policy.remember(before)
        self._policy.reset(torch.arange(1), obs)
        fresh = self._policy.memory()
        self._policy.remember(
            {n: torch.where(begins.reshape(-1, *[1] * (old.dim() - 1)), fresh[n], old) for n, old in before.items()}
        )
        target = self._policy.act(obs)
        return target, *self._policy.memory().values()


def _drawn(names: tuple[str, ...], robot: Robot, task: Task, frame: int, robots: int = ROBOTS) -> Observations:
    """What robots that stand about might observe in a frame."""
    random = torch.Generator().manual_seed(frame)
    shapes = {name: (robots, *TERMS[name].shape(robot, task)) for name in names}
    values = {name: 0.1 * torch.randn(shape, generator=random) for name, shape in shapes.items()}
    if "proprio" in values:
        values["proprio"][:, :4] += torch.tensor([0.0, 0.0, -1.0, 1.0])
    if "hands" in values:
        values["hands"] = torch.ones(shapes["hands"])
    values["time"] = torch.full((robots, 1), frame * TICK)
    return Observations(values)


def _difference(policy: Policy, path: Path, robot: Robot, task: Task) -> float:
    """The largest difference of targets [rad] over some frames, in one of which a robot begins anew."""
    other, names = load_onnx(path, robot, task), tuple(dict.fromkeys((*policy.observations, "time")))
    worst = 0.0
    for frame in range(FRAMES):
        obs = _drawn(names, robot, task, frame)
        again = torch.arange(ROBOTS) if frame == 0 else torch.tensor([1] if frame == FRAMES // 2 else [])
        obs["time"][again.long()] = 0.0
        for each in (policy, other) if len(again) else ():
            each.reset(again.long(), obs)
        apart = (policy.act(obs) - other.act(obs)).abs().nan_to_num(torch.inf)
        worst = max(worst, float(apart.max()))
    return worst
