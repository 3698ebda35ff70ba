"""Who learned by trying, of kind `explorer`, with the perception in the folder beside it if it remembers."""

from mimicbench.imitate.cloning import clone_loader
from mimicbench.imitate.exploring.network import ExplorerConfig
from mimicbench.policies.loader import Loader

LOADER = Loader("explorer", clone_loader(ExplorerConfig))
