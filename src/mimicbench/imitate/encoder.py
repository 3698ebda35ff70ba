"""A ResNet-18 for maps: 1 to 4 channels in, a grid of features out; and, for a CPU, three convolutions.

No pretrained weights: height maps are not photographs.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core.settings import BadSetting, Positive, Sizes, Within


@dataclass(frozen=True)
class EncoderConfig:
    """The size of an encoder. The defaults are ResNet-18's: 128 x 128 cells become 4 x 4 x 512."""

    channels: Positive = 1
    """Channels of the map."""
    cells: Positive = 128
    """Side of the map, in cells."""
    pool: Positive = 1
    """Take the highest of this many cells squared first."""
    patch: Annotated[int, Within(0, 128)] = 0
    """Side of the squares [cells] that the first convolution reads one by one, instead of ResNet's stem and residual
    blocks: one convolution per stage follows. 0 for ResNet."""
    widths: Sizes = (64, 128, 256, 512)
    """Channels of the four stages."""
    blocks: tuple[int, ...] = (2, 2, 2, 2)
    """Residual blocks per stage."""
    strides: Sizes = (1, 2, 2, 2)
    """By what each stage divides the side, after the stem has divided it by 4."""
    norm: Literal["group", "batch"] = "group"
    """`group` (16 channels a group, the same in training and use) or `batch`."""
    coordinates: bool = False
    """Append two channels that hold each cell's place, from -1 to 1."""

    def __post_init__(self) -> None:
        counts = (len(self.widths) - 1,) if self.patch else (len(self.widths), len(self.blocks))
        if any(count != len(self.strides) for count in counts):
            wanted = (
                "one stride less than widths, for the first stage reads patches"
                if self.patch
                else "as many strides and blocks as widths"
            )
            raise BadSetting(
                f"an encoder of widths {self.widths} has strides {self.strides} and blocks {self.blocks}; give {wanted}"
            )

    @staticmethod
    def small() -> "EncoderConfig":
        """About 150 thousand parameters for a CPU: 4 x 4 x 64."""
        return EncoderConfig(pool=2, widths=(16, 32, 48, 64), blocks=(1, 1, 1, 1), strides=(1, 2, 2, 1))

    @staticmethod
    def quick() -> "EncoderConfig":
        """About 45 thousand parameters for a CPU, 4 x 4 x 64, in a quarter of the time of the small ResNet."""
        return EncoderConfig(patch=8, widths=(32, 48, 64), blocks=(), strides=(2, 2))

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return len(self.widths), len(self.blocks), *self.blocks

    @property
    def side(self) -> int:
        """Side of the grid of features."""
        side = self.cells // self.pool // (self.patch or 1)
        for stride in (*(() if self.patch else (2, 2)), *self.strides):
            side = (side + stride - 1) // stride
        return side


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
