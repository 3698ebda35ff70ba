"""Pictures put together: several moments side by side, and videos."""

import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import IO, Any

import imageio_ffmpeg
import numpy as np
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import write_atomic

_write_frames: Any = imageio_ffmpeg.write_frames  # its annotations are guessed from its defaults

MAX_FRAMES = 20_000
"""More than thirteen minutes at 25 frames per second: no episode is that long."""


def strip(frames: Sequence[np.ndarray], captions: Sequence[str] = (), gap: int = 4) -> np.ndarray:
    """Several moments side by side.

    Args:
        frames: pictures (H, W, 3), uint8, all of the same size.
        captions: a short text for each, written into its upper left corner; none if empty.
        gap: white pixels between them.

    Returns:
        One picture (H, n W + (n - 1) gap, 3).
    """
    if not frames:
        raise MimicbenchError("a strip needs at least one picture")
    if captions and len(captions) != len(frames):
        raise MimicbenchError(f"a strip of {len(frames)} pictures needs as many captions, not {len(captions)}")
    tiles = []
    for i, frame in enumerate(frames):
        tile = captioned(frame, captions[i]) if captions else frame
        tiles += [tile, np.full((frame.shape[0], gap, 3), 255, np.uint8)]
    return np.concatenate(tiles[:-1], 1)


def stacked(rows: Sequence[np.ndarray], gap: int = 4) -> np.ndarray:
    """Pictures (H, W, 3) of one width below each other, with white pixels between them."""
    between = np.full((gap, rows[0].shape[1], 3), 255, np.uint8)
    return np.concatenate([part for row in rows for part in (row, between)][:-1])


def captioned(frame: np.ndarray, text: str) -> np.ndarray:
    """A picture (H, W, 3) with words in its upper left corner, where rarely anybody's feet are."""
    image = Image.fromarray(frame)
    size = max(11, frame.shape[0] // 15)
    font = ImageFont.truetype(str(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), size)
    place, halo = (0.6 * size, 0.5 * size), (240, 242, 245)  # dark furniture may be behind it
    ImageDraw.Draw(image).text(place, text, (70, 74, 82), font, stroke_width=max(1, size // 8), stroke_fill=halo)
    return np.asarray(image)


def jpeg(image: np.ndarray, quality: int = 86) -> bytes:
    """A picture (H, W, 3), uint8, as JPEG."""
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "JPEG", quality=quality, optimize=True)
    return stream.getvalue()


def write_jpeg(path: Path, image: np.ndarray, quality: int = 86) -> None:
    """Write a picture (H, W, 3), uint8, atomically."""
    data = jpeg(image, quality)

    def write(stream: IO[bytes]) -> None:
        stream.write(data)

    write_atomic(path, write)


def write_png(path: Path, image: np.ndarray) -> None:
    """Write a picture (H, W, 3), uint8, atomically."""

    def write(stream: IO[bytes]) -> None:
        Image.fromarray(image).save(stream, "PNG", optimize=True)

    write_atomic(path, write)


def write_video(path: Path, frames: Iterable[np.ndarray], fps: float, quality: int = 25) -> int:
    """Write an H.264 video that every browser plays, atomically.

    Args:
        path: ends in `.mp4`.
        frames: pictures (H, W, 3), uint8, with even sides, all of the same size; drawn one by one as they are needed.
        fps: frames per second.
        quality: constant rate factor of x264, lower is better and larger.

    Returns:
        The number of frames written. Nothing is left behind when `frames` raises.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp.mp4")
    writer: Any = None
    count, shape = 0, (0, 0, 3)
    try:
        for frame in frames:
            if writer is None:
                shape = frame.shape
                writer = _opened(temporary, frame, fps, quality)
            if frame.shape != shape:
                raise MimicbenchError(
                    f"the pictures of a video must have one size; {shape} is followed by {frame.shape}"
                )
            if count >= MAX_FRAMES:
                raise MimicbenchError(f"a video of more than {MAX_FRAMES} frames is refused; thin the motion out")
            writer.send(np.ascontiguousarray(frame))
            count += 1
        if writer is None:
            raise MimicbenchError(f"there are no pictures to make {path.name} of")
        writer.close()
        writer = None
        os.replace(temporary, path)
    finally:
        if writer is not None:
            writer.close()
        temporary.unlink(missing_ok=True)
    return count


def _opened(path: Path, first: np.ndarray, fps: float, quality: int) -> Any:
    """A writer of pictures like the first, ready to be sent it."""
    height, width, *rest = first.shape
    if height % 2 or width % 2 or rest != [3] or first.dtype != np.uint8:
        raise MimicbenchError(
            "a video needs pictures of even height and width with three bytes per pixel, "
            f"not {first.shape} of {first.dtype}"
        )
    ready = ["-movflags", "+faststart"]
    same_bytes = ["-fflags", "+bitexact", "-flags:v", "+bitexact"]
    writer = _write_frames(
        str(path),
        (width, height),
        fps=fps,
        codec="libx264",
        pix_fmt_out="yuv420p",
        quality=None,
        macro_block_size=2,
        # a whole picture every second: who moves through a video need not wait for many to be worked out
        output_params=["-crf", str(quality), "-preset", "medium", "-g", str(round(fps)), *ready, *same_bytes],
        ffmpeg_log_level="error",
    )
    writer.send(None)
    return writer
