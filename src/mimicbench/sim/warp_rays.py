"""Rays in chosen worlds on Warp."""

from collections.abc import Sequence
from copy import copy
from typing import Any

import mujoco_warp as mjw  # pyright: ignore[reportMissingImports]
import numpy as np
import torch
import warp as wp  # pyright: ignore[reportMissingImports]

_cast: Any = mjw.rays  # its types say less than what Warp's arrays are
_GROUP_MASK = wp.types.vector(length=6, dtype=float)


def cast_rays(
    model: Any, data: Any, worlds: torch.Tensor, starts: np.ndarray, rays: np.ndarray, groups: Sequence[int]
) -> np.ndarray:
    """How many lengths of each ray it is to a geom of `groups`, -1 if none.

    Args:
        model: Warp's model of all worlds.
        data: Their state, whose kinematics are up to date.
        worlds: (n,) which worlds rays are cast in.
        starts: Where rays start [m]; whatever broadcasts to (n, R, 3).
        rays: Their directions and lengths [m], (1 or n, R, 3).
        groups: The groups of geoms that rays meet.
    """
    # all that rays meet in those worlds alone: others need not cast any
    model, data = copy(model), copy(data)
    data.nworld = len(worlds)
    for owner, name in ((model, "geom_size"), (data, "geom_xpos"), (data, "geom_xmat")):
        rows = getattr(owner, name)
        setattr(owner, name, wp.from_torch(wp.to_torch(rows)[worlds], dtype=rows.dtype))
    seen = _GROUP_MASK(*(float(group in groups) for group in range(6)))
    shape = (len(worlds), rays.shape[1])
    nobody = wp.full(shape[1], -1, dtype=int)
    distance, geom = wp.empty(shape, dtype=float), wp.empty(shape, dtype=int)
    normal: Any = wp.empty(shape, dtype=wp.vec3)  # pyright: ignore[reportArgumentType]
    start, ray = (
        wp.from_torch(
            torch.from_numpy(np.asarray(given, np.float32)).to(worlds.device).expand(*shape, 3).contiguous(),
            dtype=wp.vec3,
        )
        for given in (starts, rays)
    )
    _cast(model, data, start, ray, seen, True, nobody, distance, geom, normal)
    return wp.to_torch(distance).double().cpu().numpy()
