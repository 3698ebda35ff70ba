"""Cloners of kind `act`, with the perception in the folder beside them."""

from mimicbench.imitate.policy import load_beside
from mimicbench.policies.loader import Loader

LOADER = Loader("act", load_beside)
