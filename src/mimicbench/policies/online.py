"""Who plans online, with the tracker and the perception in the folders beside it."""

from mimicbench.imitate.online.policy import load_online
from mimicbench.policies.loader import Loader

LOADER = Loader("online", load_online)
