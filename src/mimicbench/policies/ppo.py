"""Who learned by PPO alone, of kind `ppo`, with the perception in the folder beside it if it remembers."""

from mimicbench.imitate.cloning import clone_loader
from mimicbench.imitate.learners.ppo import PPONetworkConfig
from mimicbench.policies.loader import Loader

LOADER = Loader("ppo", clone_loader(PPONetworkConfig), exports=True)
