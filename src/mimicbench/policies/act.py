"""Cloners of kind `act`, with the perception in the folder beside them."""

from mimicbench.imitate.cloning import clone_loader
from mimicbench.imitate.learners.act import ACTConfig
from mimicbench.policies.loader import Loader

LOADER = Loader("act", clone_loader(ACTConfig), exports=True)
