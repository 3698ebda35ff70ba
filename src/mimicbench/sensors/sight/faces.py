"""What lines of sight meet of objects, in closed form: faces are filled into many pictures, row by row.

Along the lines of sight of a picture, everything about a plane is linear in the pixel's row and column. For a pinhole
that is the inverse of depth, for parallel lines depth itself. So are the edges of a face, and where they cut a row of
pixels, those that see the face begin and end. Pixels get the value at their centers, as if a ray had been followed
through each, and only those that see a face cost anything. No simulator is asked, so it is the same for all of them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

CRACK = 1e-6
"""[px] Faces are this much wider on either side, so that no pixel's center falls between two that share an edge."""
_PIXELS_AT_ONCE = 1 << 15
"""That are filled at a time; a picture has fewer columns."""
_COUNTING = np.arange(_PIXELS_AT_ONCE)
_COUNTING_FLOAT = np.arange(_PIXELS_AT_ONCE, dtype=np.float32)


@dataclass(frozen=True)
class Faces:
    """Faces in pictures. A linear form (a, b, c) is a + b row + c column."""

    picture: np.ndarray
    """(F,) which picture it is in."""
    value: np.ndarray
    """(F, 3) form of what pixels get that see it; of several faces the largest value is seen."""
    edges: np.ndarray
    """(F, 4, 3) forms that are not negative where it is."""
    first: np.ndarray
    """(F,) row that it can be in."""
    last: np.ndarray
    """(F,) row that it can be in."""
    surface: np.ndarray
    """(F,) which surface of the scenes it is."""

    def fill(self, rows: np.ndarray, start: np.ndarray) -> None:
        """Raise the pixels of rows (R, width), float32, to the faces that they see.

        Args:
            rows: Of all pictures.
            start: (P,) which of them is row 0 of each picture.
        """
        for pixel, value, _, _ in self._pixels(rows.shape[1], start):
            raise_to(rows, pixel, value)

    def surfaces(self, rows: np.ndarray, start: np.ndarray) -> np.ndarray:
        """(R, width) which surface each pixel of the filled rows shows; -1 where it is none of them."""
        found = np.full(rows.size, -1)
        filled = rows.reshape(-1)
        for pixel, value, face, count in self._pixels(rows.shape[1], start):
            seen = value >= filled[pixel]
            found[pixel[seen]] = np.repeat(self.surface[face], count)[seen]
        return found.reshape(rows.shape)

    def _pixels(self, width: int, start: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
        """All pixels of all faces, some at a time: their places in the rows and their values (K,), float32, and, of
        each of the spans that they make up in turn, the face and how many pixels it has.
        """
        face, row, begin, end = self._spans(width)
        length = end - begin + 1
        some = np.flatnonzero(length > 0)
        face, row, begin, length = face[some], row[some], begin[some], length[some].astype(np.intp)
        form = self.value.T[:, face]
        value = np.stack([form[2], form[0] + form[1] * row + form[2] * begin]).astype(np.float32)
        place = (start[self.picture[face]] + row) * width + begin.astype(np.intp)
        # all pixels of all rows of all faces in one line, so many at a time that a processor's cache holds them
        after = np.cumsum(length)
        first = 0
        while first < len(length):
            done = after[first] - length[first]
            last = int(np.searchsorted(after, done + _PIXELS_AT_ONCE, "right"))
            part = slice(first, last)
            count, before = length[part], after[part] - length[part] - done
            pixel = np.repeat(place[part] - before, count)
            pixel += _COUNTING[: len(pixel)]
            step, slope, base = np.repeat(np.stack([before.astype(np.float32), *value[:, part]]), count, axis=1)
            np.subtract(_COUNTING_FLOAT[: len(step)], step, out=step)
            step *= slope
            step += base
            yield pixel, step, face[part], count
            first = last

    def _spans(self, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(S,) faces, rows, and the first and the last pixel of each face in each of its rows."""
        count = self.last - self.first + 1
        face = np.repeat(np.arange(len(count)), count)
        row = np.arange(len(face)) - np.repeat(np.cumsum(count) - count - self.first, count)
        base, down, along = self.edges.T
        with np.errstate(divide="ignore", invalid="ignore"):
            at, per_row = -(base / along), down / along
        level = along == 0
        at[level] = per_row[level] = 0
        # edges on the one side bound the first pixel, those on the other side the last
        left, right = np.where(along > 0, at, -np.inf), np.where(along < 0, at, np.inf)
        left, right, per_row = np.repeat(np.stack([left, right, per_row]), count, axis=2)
        per_row *= row
        left -= per_row
        right -= per_row
        begin = np.maximum(np.maximum(left[0], left[1]), np.maximum(left[2], left[3])) - CRACK
        end = np.minimum(np.minimum(right[0], right[1]), np.minimum(right[2], right[3])) + CRACK
        begin, end = np.maximum(begin, 0), np.minimum(end, width - 1)
        for edge in np.flatnonzero(level.any(1)):
            end[level[edge, face] & (base[edge, face] + down[edge, face] * row < 0)] = -1
        return face, row, np.ceil(begin), np.floor(end)


def raise_to(heights: np.ndarray, place: np.ndarray, values: np.ndarray) -> None:
    """Raise the entries of `heights`, float32, in places (K,) of its flat view to values (K,), in no certain order.

    As `np.maximum.at`, in half the time and without holding up other threads.
    """
    torch.from_numpy(heights.reshape(-1)).scatter_reduce_(0, torch.from_numpy(place), torch.from_numpy(values), "amax")
