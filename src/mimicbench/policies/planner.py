"""Planners, with the tracker and the perception in the folders beside them."""

from mimicbench.imitate.planner import load_planner
from mimicbench.policies.loader import Loader

LOADER = Loader("planner", load_planner, exports=True)
