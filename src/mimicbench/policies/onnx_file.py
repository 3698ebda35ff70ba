"""Policies of ONNX files: a network that was trained anywhere, judged as ours are.

A file has one input for each observation term, (N, *shape) of 32-bit floats, in the order in which its metadata
`observations` names them, separated by commas; its first output are the joint targets (N, J) [rad]. N is free, or 1.
Its metadata `gains` says which of the robot's gains they are meant for, `robot` and `task`, if there, whom and what it
is made for.

What a policy has to remember is carried: metadata `carried` names further inputs, (N, ...) of 32-bit floats, 64-bit
integers or booleans, which follow those of the terms, and whose values in the next frame are the further outputs, in
the same order. In the first frame of an episode, when the term `time` is 0, they are zeros.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName
from mimicbench.envs.policy import refuse_privileged
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations, chosen_terms
from mimicbench.tasks.task import Task

MAX_BYTES = 2 << 30
MISSING = "{} needs {}, which is not installed; install it with `pip install 'mimicbench[onnx]'`"


class OnnxPolicy:
    """A network of an ONNX file in closed loop, on one thread of the processor."""

    def __init__(self, session: Any, observations: Sequence[str], gains: str, carried: int) -> None:
        """Of an onnxruntime session whose inputs are the terms and then those that are carried."""
        self.observations: tuple[str, ...] = tuple(observations)
        self.gains = gains
        self._session, self._device = session, "cpu"
        inputs = session.get_inputs()
        self._names = [one.name for one in inputs]
        self._carries = inputs[len(inputs) - carried :]
        self._outputs = [one.name for one in session.get_outputs()[: 1 + carried]]
        self._alone = any(one.shape[0] == 1 for one in inputs)
        self._carried: list[np.ndarray] = []

    def to(self, device: str) -> None:
        """Take observations from a device, and give targets there."""
        self._device, self._carried = device, []

    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Robots `ids` (M,) remember nothing."""
        if not self._carried or len(self._carried[0]) != obs.num_envs:
            shapes = [(obs.num_envs, *one.shape[1:]) for one in self._carries]
            kinds = [_TYPES[one.type] for one in self._carries]
            self._carried = [np.zeros(shape, kind) for shape, kind in zip(shapes, kinds, strict=True)]
        for values in self._carried:
            values[ids.cpu().numpy()] = 0

    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad]."""
        values = [*(obs[name].float().cpu().numpy() for name in self.observations), *self._carried]
        robots = [slice(i, i + 1) for i in range(obs.num_envs)] if self._alone else [slice(None)]
        found = [self._session.run(self._outputs, self._feed(values, some)) for some in robots]
        target, *self._carried = [np.concatenate(parts) for parts in zip(*found, strict=True)]
        return torch.from_numpy(target).to(self._device)

    def _feed(self, values: Sequence[np.ndarray], robots: slice) -> dict[str, np.ndarray]:
        return {name: np.ascontiguousarray(value[robots]) for name, value in zip(self._names, values, strict=True)}


_TYPES = {"tensor(float)": np.float32, "tensor(int64)": np.int64, "tensor(bool)": np.bool_}
"""Of what may be carried."""


def load_onnx(path: Path, robot: Robot, task: Task) -> OnnxPolicy:
    """The policy in an ONNX file.

    Raises:
        BadFile: It is not there, no ONNX, or of another robot or task.
        UnknownName: It observes what does not exist, or drives gains that the robot does not have.
        MimicbenchError: onnxruntime is not installed, or the policy's inputs and outputs are not those of a policy.
    """
    session = _session(path)
    notes: dict[str, str] = session.get_modelmeta().custom_metadata_map
    if "observations" not in notes:
        raise BadFile(
            f"{path} does not say what it observes; put the names of its inputs' terms into its metadata "
            "`observations`, separated by commas"
        )
    for what, wanted in (("robot", robot.name), ("task", task.name)):
        if notes.get(what, wanted) != wanted:
            raise BadFile(f"{path} is a policy of {what} {notes[what]!r}, not of {wanted!r}; give one of that")
    names, carried = _words(notes["observations"]), _words(notes.get("carried", ""))
    refuse_privileged(names, f"the policy of {path}")
    terms = {term.name: term.shape(robot, task) for term in chosen_terms(names, task)}
    lacking = [name for name in names if name not in terms]
    if lacking:
        raise MimicbenchError(
            f"{path} observes {lacking[0]!r}, which {task.name} does not have; judge it on another task"
        )
    gains = notes.get("gains", "")
    if not gains:
        raise BadFile(
            f"{path} does not say what gains its targets are meant for; put one of {', '.join(robot.gains)} into its "
            "metadata `gains`"
        )
    if gains not in robot.gains:
        raise UnknownName("gains", gains, list(robot.gains))
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if not names or len(inputs) != len(names) + len(carried) or len(outputs) < 1 + len(carried):
        raise MimicbenchError(
            f"{path} has {len(inputs)} inputs and {len(outputs)} outputs, but names {len(names)} observations and "
            f"{len(carried)} values to carry; name one for each input, and at least one"
        )
    for one, name in zip(inputs, names, strict=False):
        _check(path, one, f"observation {name!r}", terms[name])
    for one in inputs[len(names) :]:
        _check(path, one, "a value to carry", tuple(one.shape[1:]), tuple(_TYPES))
    _check(path, outputs[0], "the joint targets", (len(robot.joints),))
    return OnnxPolicy(session, names, gains, len(carried))


def _session(path: Path) -> Any:
    """An onnxruntime session of a file, on one thread: sums round differently on more."""
    if not path.is_file():
        raise BadFile(f"{path} does not exist; give the path of an ONNX file")
    if path.stat().st_size > MAX_BYTES:
        raise BadFile(f"{path} is larger than {MAX_BYTES >> 30} GiB; it is no policy")
    try:
        import onnxruntime
    except ImportError:
        raise MimicbenchError(MISSING.format(path, "onnxruntime")) from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # noqa: BLE001 onnxruntime has a dozen kinds, none of which it documents
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise BadFile(f"{path} cannot be read as ONNX ({reason}); export it again") from None


def _check(
    path: Path, one: Any, what: str, shape: tuple[int, ...], types: tuple[str, ...] = ("tensor(float)",)
) -> None:
    """Raises MimicbenchError if an input or output is not (N, *shape), N free or 1; sizes of -1 may be any."""
    found = tuple(one.shape)
    free = bool(found) and (found[0] == 1 or not isinstance(found[0], int))
    same = len(found) == 1 + len(shape) and all(
        not isinstance(has, int) or wants in (-1, has) for has, wants in zip(found[1:], shape, strict=True)
    )
    if not (free and same and one.type in types and all(isinstance(size, int) for size in shape)):
        wanted = " x ".join(["N", *(str(size) if isinstance(size, int) else "a fixed size" for size in shape)])
        given = " x ".join(map(str, found)) or "a single number"
        raise MimicbenchError(
            f"{path}: {one.name!r} stands for {what} and is {given} of {one.type}; it has to be {wanted} of "
            f"{types[0]}, N free or 1"
        )


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
