"""A policy beside test objects with heights times LO to HI, from rest: low.py OBJECTS TASK POLICY LO HI EPISODES."""

import sys
from pathlib import Path

import torch

from mimicbench.envs.rule_starts import standing
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate.learn_perception import of_other_heights
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.objects.make import read_objects
from mimicbench.policies.loading import load_policy
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS

torch.set_num_threads(1)
folder, name, policy, lo, hi, episodes = sys.argv[1:]
task, robot = TASKS.get(name), ROBOTS.get("h1")
unseen = [obj for obj in read_objects(Path(folder)).values() if obj.split == "test"]
low = of_other_heights(PerceptionConfig(seed=5, heights=(float(lo), float(hi))), unseen)
clips = standing(task, robot, {obj.id: obj for obj in low}, int(episodes), 7)
runs = run_policy(load_policy(Path(policy), robot, task), clips, env_config=EnvConfig(workers=1))
for what in ("success", "stays", "fell"):
    print(what, sum(int(getattr(run.verdict, what).sum()) for run in runs))
