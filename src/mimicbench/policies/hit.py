"""HIT, with the tracker in the folder beside it."""

from mimicbench.imitate.networks.hit import load_hit
from mimicbench.policies.loader import Loader

LOADER = Loader("hit", load_hit, exports=True)
