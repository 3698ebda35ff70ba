"""Names of what can compute the physics.

Knows no simulator, so that whoever only asks for a device need not load one.
"""

import re

from mimicbench.core.errors import UnknownName

CPU, WARP_CPU = "cpu", "warp-cpu"
DEVICES = (CPU, "cuda", "cuda:1", WARP_CPU)
"""MuJoCo on threads; MuJoCo Warp on the first GPU, on a certain one; and without a GPU, slowly, for tests."""


def tensor_device(device: str) -> str:
    """Where the tensors of physics on `device` live, as torch calls it: `cpu`, `cuda` or `cuda:1`.

    Raises UnknownName.
    """
    if device in (CPU, WARP_CPU):
        return "cpu"
    if re.fullmatch(r"cuda(:\d{1,3})?", device):
        return device
    raise UnknownName("device", device, list(DEVICES))
