"""What an imported object was made from, and why it came out as it did."""

from dataclasses import dataclass, fields
from pathlib import Path

import msgspec
import numpy as np

from mimicbench.core.errors import BadFile
from mimicbench.core.files import read_record


@dataclass(frozen=True)
class Evidence:
    """What an imported object was made from, and why it came out as it did."""

    id: str
    file: str
    sha256: str
    meters_per_unit: float
    up: str
    front: str
    size: tuple[float, float, float]
    """Front to back, width, height [m]."""
    pieces: int
    boxes: int
    """How many of the pieces are boxes."""
    filled: float
    """Volume of the convex pieces over the volume of the boxes around them."""
    seat_height: float | None
    """Of the pieces' top within the outline [m]."""
    mesh_seat_height: float | None
    """Of the mesh itself [m]."""
    seat_area: float | None
    """[m^2]"""
    seat_polygon: list[list[float]]
    reasons: tuple[str, ...]

    def text(self) -> str:
        """A few lines to read."""
        lines = [
            f"{self.file} -> {self.id}: {' x '.join(f'{side:.2f}' for side in self.size)} m, "
            f"{self.pieces} pieces ({self.boxes} of them boxes)"
        ]
        if self.seat_height is not None and self.seat_area is not None:
            low, high = np.min(self.seat_polygon, 0), np.max(self.seat_polygon, 0)
            lines.append(
                f"  plane at {self.seat_height:.3f} m, {self.seat_area:.2f} m2, x {low[0]:.2f} to "
                f"{high[0]:.2f}, y {low[1]:.2f} to {high[1]:.2f}, "
                f"{len(self.seat_polygon)} corners"
            )
        return "\n".join([*lines, *(f"  {reason}" for reason in self.reasons)])


def read_evidence(folder: Path, object_id: str) -> Evidence:
    """Of an object of a folder. Raises BadFile."""
    path = folder / "evidence" / f"{object_id}.json"
    try:
        return msgspec.convert(read_record(path, [entry.name for entry in fields(Evidence)]), Evidence)
    except msgspec.ValidationError as error:
        raise BadFile(f"{path} is no evidence of an import ({error}); delete {folder} and import again") from None
