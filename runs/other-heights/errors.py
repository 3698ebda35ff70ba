"""How far eyes err on objects that nobody has, as they are and lower: errors.py TASK PERCEPTION ..."""

import sys
from pathlib import Path

import torch

from mimicbench.imitate.learn_perception import Sights, draw_maps, of_other_heights
from mimicbench.imitate.perception import load_perception
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.objects.registry import FAMILIES
from mimicbench.tasks.registry import TASKS

task = TASKS.get(sys.argv[1])
made = [FAMILIES.get(task.family).make(index, 99) for index in range(300)]
low = of_other_heights(PerceptionConfig(seed=5, heights=(0.4, 0.6)), made)
for what, objects in (("as they are", made), ("low", low)):
    maps = draw_maps(PerceptionConfig(seed=5), task, Sights.of(task, objects), 1500, "compare", seen=1.0)
    for folder in sys.argv[2:]:
        with torch.no_grad():
            goal, _ = load_perception(Path(folder), "h1").look(maps.maps, maps.root_height)
        nearest = (goal[:, None] - maps.answers).square().sum(-1).argmin(1)
        right, told = maps.answers[torch.arange(len(goal)), nearest], []
        for field in task.goal.fields:
            columns = list(task.goal.columns[field.name])
            a, b = goal[:, columns], right[:, columns]
            if field.kind == "direction":
                off = torch.atan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(1)).abs()
                told.append(f"{field.name} {off.median():.3f} rad, wrong {100 * (off > 0.35).float().mean():.1f} %")
            else:
                told.append(f"{field.name} {100 * (a - b).norm(dim=1).median():.1f} cm")
        print(what, folder, "; ".join(told))
