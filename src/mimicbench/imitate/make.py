"""What stage `imitate` makes beside a policy: the eyes, which every policy with a memory looks through."""

from collections.abc import Sequence
from pathlib import Path

from mimicbench.core.checkpoint import CONFIG
from mimicbench.core.progress import counter
from mimicbench.imitate.learn_perception import evaluate_perception, train_perception
from mimicbench.imitate.perception import PerceptionConfig, save_perception
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.tasks.task import Task


def make_perception(
    folder: Path,
    task: Task,
    robot: Robot,
    objects: Sequence[SceneObject],
    held_out: Sequence[SceneObject],
    config: PerceptionConfig,
    quiet: bool,
) -> dict[str, float]:
    """Learn to find a task's goal beside `objects` in elevation maps; `held_out` measures how well. Does nothing if
    that is done.
    """
    if (folder / CONFIG).exists():
        return {}
    with counter(config.steps, "perception", quiet) as tick:
        network = train_perception(
            folder, config, task, objects, lambda batches, loss: tick(batches, f"loss {loss:.3f}")
        )
    error = evaluate_perception(network, task, held_out)
    save_perception(folder, network, robot.name, error)
    return error
