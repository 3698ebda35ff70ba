"""A ResNet-18 for maps: 1 to 4 channels in, a grid of features out; and, for a CPU, three convolutions.

No pretrained weights: height maps are not photographs.
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.imitate.settings.encoder import EncoderConfig


class Encoder(nn.Module):
    """Maps (N, channels, cells, cells) -> features (N, widths[-1], side, side)."""

    def __init__(self, config: EncoderConfig) -> None:
        super().__init__()
        self.config = config
        channels = config.channels + (2 if config.coordinates else 0)
        if config.patch:
            self.stem, self.stages = self._plain(channels)
            return
        self.stem = nn.Sequential(
            nn.Conv2d(channels, config.widths[0], 7, 2, 3, bias=False),
            norm_layer(config.norm, config.widths[0]),
            nn.ReLU(),
            nn.MaxPool2d(3, 2, 1),
        )
        stages: list[nn.Module] = []
        width_in = config.widths[0]
        for width, blocks, stride in zip(config.widths, config.blocks, config.strides, strict=True):
            for block in range(blocks):
                stages.append(_Block(width_in, width, stride if block == 0 else 1, config.norm))
                width_in = width
        self.stages = nn.Sequential(*stages)

    def _plain(self, channels: int) -> tuple[nn.Sequential, nn.Sequential]:
        widths, patch = self.config.widths, self.config.patch
        stages: list[nn.Module] = []
        for width_in, width, stride in zip(widths[:-1], widths[1:], self.config.strides, strict=True):
            stages += [nn.Conv2d(width_in, width, 3, stride, 1), nn.ReLU()]
        # no padding: a side that is no multiple of the patch loses its last cells
        return nn.Sequential(nn.Conv2d(channels, widths[0], patch, patch), nn.ReLU()), nn.Sequential(*stages)

    def forward(self, maps: Tensor) -> Tensor:
        """Encode a batch of maps."""
        if self.config.pool > 1:
            maps = functional.max_pool2d(maps, self.config.pool)
        if self.config.coordinates:
            maps = append_coordinates(maps)
        return self.stages(self.stem(maps))


class _Block(nn.Module):
    """relu(x + norm(conv(relu(norm(conv(x)))))), with a 1 x 1 convolution on the way past where the shape changes."""

    def __init__(self, width_in: int, width: int, stride: int, norm: str) -> None:
        super().__init__()
        self.first = nn.Conv2d(width_in, width, 3, stride, 1, bias=False)
        self.first_norm = norm_layer(norm, width)
        self.second = nn.Conv2d(width, width, 3, 1, 1, bias=False)
        self.second_norm = norm_layer(norm, width)
        changes = stride != 1 or width_in != width
        self.past = (
            nn.Sequential(nn.Conv2d(width_in, width, 1, stride, bias=False), norm_layer(norm, width))
            if changes
            else nn.Identity()
        )

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu(self.first_norm(self.first(x)))
        return functional.relu(self.past(x) + self.second_norm(self.second(y)))


def norm_layer(norm: str, width: int) -> nn.Module:
    """A normalization over `width` channels."""
    return nn.BatchNorm2d(width) if norm == "batch" else nn.GroupNorm(max(1, width // 16), width)


def append_coordinates(maps: Tensor) -> Tensor:
    """Maps (N, C, H, W) with two more channels: the row's and the column's place, from -1 to 1."""
    rows = torch.linspace(-1, 1, maps.shape[2], device=maps.device)[:, None].expand(maps.shape[2:])
    columns = torch.linspace(-1, 1, maps.shape[3], device=maps.device)[None, :].expand(maps.shape[2:])
    return torch.cat([maps, torch.stack([rows, columns]).expand(len(maps), -1, -1, -1)], 1)


def sine_positions_2d(side: int, width: int) -> Tensor:
    """(1, side * side, width): half of the numbers tell the row, half the column, both scaled to 0..2 pi (Carion et al.

    2020).
    """
    place = (torch.arange(side) + 1.0) / side * (2 * math.pi)
    rate = torch.exp(torch.arange(0, width // 2, 2) * (-math.log(10000.0) / (width // 2)))
    line = torch.stack([(place[:, None] * rate).sin(), (place[:, None] * rate).cos()], -1).flatten(1)
    return torch.cat([line[:, None].expand(-1, side, -1), line[None].expand(side, -1, -1)], -1).reshape(
        1, side * side, width
    )
