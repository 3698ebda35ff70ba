"""How near robots are to having done their task: the dense reward of every task, by what its K still lacks."""

import numpy as np

from mimicbench.envs.vec_env import VecEnv
from mimicbench.tasks.task import BodyPoints


def nearness(env: VecEnv) -> np.ndarray:
    """(N,) from 0 to 1 how near the condition of K is to holding: exp(-d) of the d [m] that are missing in all.

    1 where it holds; 0 for robots that have fallen, and of physics that broke down. The environment has to be judged.
    """
    links, metrics = env.context.links, env.metrics
    assert metrics is not None, "an environment that is not judged knows of no K"
    body = BodyPoints.of(env.robot, links.pos_w.cpu().numpy(), links.quat_w.cpu().numpy())
    info = metrics.info.map(lambda values: values.cpu().numpy())
    if env.task.moves_object:
        info = info.moved(*env.physics.object_pose())
    missing = sum(np.nan_to_num(part.measure(body, info)).clip(0.0) for part in env.task.shortfalls)
    lost = metrics.fell | metrics.diverged
    return np.where(lost.cpu().numpy(), 0.0, np.exp(-np.asarray(missing, float)))
