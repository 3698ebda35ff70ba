"""What can be set of the network that reads maps."""

from dataclasses import dataclass
from typing import Annotated, Literal

from mimicbench.core.settings import BadSetting, Positive, Sizes, Within

CELLS = 128
"""Side of maps and pictures as learners see them."""


@dataclass(frozen=True)
class EncoderConfig:
    """The size of an encoder. The defaults are ResNet-18's: 128 x 128 cells become 4 x 4 x 512."""

    channels: Positive = 1
    """Channels of the map."""
    cells: Positive = CELLS
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

        if self.norm == "group" and (odd := [width for width in self.widths if width % max(1, width // 16)]):
            raise BadSetting(
                f"an encoder of widths {self.widths} is normalized in groups of 16 channels, into which {odd[0]} do "
                "not go; give multiples of 16"
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
