"""Cloners of kind `diffusion`, with the perception in the folder beside them."""

from mimicbench.imitate.cloning import clone_loader
from mimicbench.imitate.learners.diffusion import DiffusionConfig
from mimicbench.policies.loader import Loader

LOADER = Loader("diffusion", clone_loader(DiffusionConfig), exports=True)
