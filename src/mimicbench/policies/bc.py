"""Cloners of kind `bc`, with the perception in the folder beside them."""

from mimicbench.imitate.cloning import clone_loader
from mimicbench.imitate.learners.bc import BCConfig
from mimicbench.policies.loader import Loader

LOADER = Loader("bc", clone_loader(BCConfig), exports=True)
