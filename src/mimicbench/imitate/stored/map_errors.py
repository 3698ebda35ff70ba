"""Elevation maps that are less than perfect, for learners to get used to."""

import torch
from torch import Tensor

from mimicbench.imitate.settings.cloning import MapErrors

SQUARE = 8
"""Side of the squares that may be missing in a map [cells]."""


def disturbed(maps: Tensor, root_height: Tensor, errors: MapErrors, generator: torch.Generator) -> Tensor:
    """Maps (B, 128, 128), heights relative to roots that are at heights (B,) [m], with errors."""
    count, side = len(maps), maps.shape[-1]
    floor = -root_height[:, None, None]
    if errors.shift:
        by = (errors.shift * torch.randn(2, count, 1, generator=generator)).round().long()
        row, column = ((torch.arange(side) - along)[:, :, None] for along in by)
        column = column.transpose(1, 2)
        there = ((row >= 0) & (row < side)) & ((column >= 0) & (column < side))
        of = torch.arange(count)[:, None, None]
        maps = torch.where(there, maps[of, row.clamp(0, side - 1), column.clamp(0, side - 1)], floor)
    if errors.cells:
        maps = maps + errors.cells * torch.randn(maps.shape, generator=generator)
    if errors.height:
        maps = maps + errors.height * torch.randn(count, 1, 1, generator=generator)
    if errors.missing:
        squares = torch.rand(count, side // SQUARE, side // SQUARE, generator=generator) < errors.missing
        gone = squares.repeat_interleave(SQUARE, 1).repeat_interleave(SQUARE, 2)
        maps = torch.where(gone, floor, maps)
    return maps
