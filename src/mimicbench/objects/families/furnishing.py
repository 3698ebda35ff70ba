"""What the makers of household objects share: sizes, colors, round shapes out of boxes, and which faces are for
touching.
"""

from dataclasses import dataclass, field

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.families.parts import Color, Parts

PAINTS: tuple[Color, ...] = (
    (0.30, 0.42, 0.52),
    (0.65, 0.33, 0.25),
    (0.42, 0.52, 0.40),
    (0.82, 0.64, 0.28),
    (0.78, 0.76, 0.72),
    (0.36, 0.30, 0.42),
    (0.20, 0.45, 0.46),
)
METALS: tuple[Color, ...] = ((0.62, 0.63, 0.65), (0.25, 0.25, 0.27), (0.72, 0.62, 0.42))
WHITE_GOODS: tuple[Color, ...] = ((0.92, 0.92, 0.92), (0.92, 0.92, 0.92), (0.72, 0.74, 0.76), (0.78, 0.86, 0.82))
DARK: Color = (0.13, 0.14, 0.16)
GLASS: Color = (0.22, 0.27, 0.32)


@dataclass(frozen=True)
class Draft:
    """What is drawn of a household object before it is built: its size over everything [m], and its colors."""

    length: float
    """Front to back, along x."""
    width: float
    height: float
    wood: Color
    paint: Color
    metal: Color
    white: Color


@dataclass
class Furnishing(Parts):
    """A growing list of boxes, some of whose faces are for touching."""

    faces: list[tuple[int, str]] = field(default_factory=list)
    """Index of the box and side (see `touch.SIDES`)."""

    def touch(self, *sides: str) -> None:
        """The box added last is for touching on these sides."""
        self.faces += [(len(self.pos) - 1, side) for side in sides]

    def handle(self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], rgb: Color) -> None:
        """A handle: a box to be touched on its front."""
        self.box(x, y, z, rgb)
        self.touch("front")

    def prism(
        self,
        center: tuple[float, float, float],
        radius: float,
        half: float,
        rgb: Color,
        axis: int = 2,
        corners: int = 8,
        touch: tuple[str, ...] = (),
    ) -> None:
        """A regular prism, 8 or 6 corners, out of corners / 2 boxes across each other.

        Args:
            center: its middle.
            radius: from the axis to the flat sides, two of which look along y.
            half: half of its length along the axis.
            rgb: its color.
            axis: 2 for an upright prism, 0 for one that lies along x.
            corners: 8, or 6 to save a box.
            touch: `around` if its front and sides can be touched, `top` if its top can; of an upright one with 8
                corners.
        """
        edge = radius * np.tan(np.pi / corners)
        for i in range(corners // 2):
            angle = i * 2 * np.pi / corners
            quat = np.zeros(4)
            quat[0], quat[1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
            # ends that are not quite level: faces in one plane would flicker in pictures
            end = half - 0.0004 * i
            sizes = (edge, radius, end) if axis == 2 else (end, radius, edge)
            self.add(np.array(center), np.array(sizes), rgb, quat)
            around = (("left", "right"), ("front left",), ("front",), ("front right",))[i] if "around" in touch else ()
            self.touch(*around, *(("top",) if "top" in touch and i % 2 == 0 else ()))

    def wall(
        self,
        center: tuple[float, float, float],
        radius: tuple[float, float],
        height: float,
        thickness: float,
        rgb: Color,
    ) -> None:
        """An open vessel of eight walls: radius at the bottom and at the top, to the outside of the flat sides.

        Its front, sides and rim can be touched.
        """
        lean = np.arctan2(radius[1] - radius[0], height)
        length = height / np.cos(lean)
        for i in range(8):
            turn = rot.from_yaw(np.array(i * np.pi / 4))
            tilt = np.array([np.cos(lean / 2), 0.0, np.sin(lean / 2), 0.0])
            # the middle of the wall's outer face is half way up; corners meet at the widest place
            out = np.array([sum(radius) / 2 - thickness / 2 * np.cos(lean), 0.0, 0.0])
            place = np.array(center) + np.array([0, 0, height / 2]) + rot.rotate(turn, out)
            edge = max(radius) * np.tan(np.pi / 8)
            sides = np.array([thickness / 2, edge, (length - thickness * abs(np.tan(lean))) / 2])
            self.add(place, sides, rgb, rot.multiply(turn, tilt))
            side = {0: "front", 1: "front right", 2: "right", 6: "left", 7: "front left"}.get(i)
            if side:
                self.touch(side, "top")
