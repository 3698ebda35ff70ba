"""Policies by where they are: the folder of a checkpoint, whose kind says who reads it, a Python or an ONNX file.

A Python file has a function `make_policy()` that returns a `Policy`: how anything that was trained elsewhere is judged.
It is a program and may do whatever programs do; checkpoints are data, and nothing in them is executed.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from mimicbench.core.checkpoint import BadCheckpoint, checkpoint_kind, checkpoint_task
from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName, told
from mimicbench.core.files import back_again
from mimicbench.envs.policy import Policy, refuse_privileged
from mimicbench.policies.neighbors import AmongNeighbors, Neighbors
from mimicbench.policies.onnx_file import load_onnx
from mimicbench.policies.registry import LOADERS
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import chosen_terms
from mimicbench.sensors.term import Term
from mimicbench.tasks.task import Task


def load_policy(path: Path, robot: Robot, task: Task) -> Policy:
    """The policy in a checkpoint's folder, or of a Python or ONNX file.

    Raises:
        BadFile: There is neither, the checkpoint cannot be read, or nobody reads checkpoints of that kind.
        UnknownName: The policy observes what does not exist.
        MimicbenchError: The Python file fails, or makes something else than a policy; the ONNX file has other inputs.
    """
    if path.suffix == ".py":
        return _of_file(path, robot, task)
    if path.suffix == ".onnx":
        return load_onnx(path, robot, task)
    if (kind := checkpoint_kind(path)) not in LOADERS:
        raise BadFile(
            f"{path} holds a checkpoint of kind {kind!r}, which is no policy; give the folder of one of these kinds: "
            + ", ".join(LOADERS)
        )
    loader = LOADERS.get(kind)
    try:
        return loader.load(path, robot, task)
    except BadCheckpoint:
        if (learned_at := checkpoint_task(path)) in ("", task.name):
            raise
        raise BadFile(
            f"{path} was learned at {learned_at}, and does not fit {task.name}; judge it there (--task {learned_at})"
        ) from None


def _of_file(path: Path, robot: Robot, task: Task) -> Policy:
    if not path.is_file():
        raise BadFile(f"{path} does not exist; give the path of a Python file with a function make_policy()")
    neighbors = Neighbors(path.parent)
    try:
        with back_again(), neighbors.there():
            module = _module(path)
            if not hasattr(module, "make_policy"):
                raise MimicbenchError(f"{path} has no function make_policy(); write one that returns a policy")
            policy = module.make_policy()
    except MimicbenchError:
        raise
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise MimicbenchError(f"{path} makes no policy: {told(error)}; mend it") from error
    lacking = [name for name in ("observations", "gains", "to", "reset", "act") if not hasattr(policy, name)]
    if lacking:
        raise MimicbenchError(
            f"make_policy() of {path} returns {type(policy).__name__} without {' and '.join(lacking)}; a policy has "
            "observations, gains, to(device), reset(ids, obs) and act(obs)"
        )
    _check_words(path, policy)
    refuse_privileged(policy.observations, f"the policy of {path}")
    chosen_terms(policy.observations, task)
    if policy.gains not in robot.gains:
        raise UnknownName("gains", policy.gains, list(robot.gains))
    return AmongNeighbors(policy, neighbors)


def _check_words(path: Path, policy: Policy) -> None:
    """Raises MimicbenchError if what a Python file's policy observes and drives are no names."""
    if isinstance(policy.observations, str):
        raise MimicbenchError(f"the policy of {path} observes a string; give a tuple of names")
    if not isinstance(policy.observations, tuple | list):
        given = type(policy.observations).__name__
        raise MimicbenchError(f"what the policy of {path} observes is a {given}; give a tuple of names")
    odd = [name for name in policy.observations if not isinstance(name, str | Term)]
    if odd:
        raise MimicbenchError(f"the policy of {path} observes {odd[0]!r}, which is no name; give a tuple of names")
    if not isinstance(policy.gains, str):
        raise MimicbenchError(f"the gains of the policy of {path} are a {type(policy.gains).__name__}; give their name")


def _module(path: Path) -> ModuleType:
    """Run a Python file under a name that no library has."""
    place = path.parent.resolve() / path.name  # where its neighbors are, so that it leaves with them
    spec = importlib.util.spec_from_file_location(f"_policy_{path.stem}", place)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
