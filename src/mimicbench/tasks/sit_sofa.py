"""Sitting on a sofa (SS): navigate, locate, and stably sit on a fixed, unseen sofa."""

from mimicbench.robots.rigs import PELVIS_RIG
from mimicbench.tasks.seat import seat
from mimicbench.tasks.sit_chair import SHORTFALLS, pelvis_above_seat
from mimicbench.tasks.task import Task

TASK = Task(
    name="sit-sofa",
    abbreviation="SS",
    title="Sit on a sofa",
    action="sitting down",
    family="sofa",
    time_limit=20.0,
    hold_time=0.3,
    holds=pelvis_above_seat,  # "K is the same as that for SC" (appendix D.1)
    shortfalls=SHORTFALLS,
    goal=seat(window=2.4),
    in_last_frame=False,
    requires_seat=True,
    upright=True,
    max_start_distance=2.0,
    rig=PELVIS_RIG,
    map_cell=0.04,
    height_weight=100.0,
)
