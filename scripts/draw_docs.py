"""Draws every picture of the documents anew: `python scripts/draw_docs.py [NAME ...] [--real FOLDER]`. Needs OpenGL.

NAME are files in docs/images; by default all whose content has changed since they were drawn (--all: all). Pictures of
recorded people need the recordings of `shared/data` (--real); without them they stay as they are. What each picture
showed when it was drawn is kept in docs/images/manifest.json, and a test says which are stale.
"""

import argparse
import io
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from doc_pictures import objects, people, policies, real, results, robots, senses
from doc_pictures.picture import DocPicture, Fingerprint, fingerprint, same
from mimicbench.core.files import read_json, write_atomic

IMAGES = Path(__file__).parents[1] / "docs" / "images"
MANIFEST = IMAGES / "manifest.json"
COLORS = 128
"""Of a PNG, so that it stays small."""


def main() -> None:
    """Draw."""
    parser = argparse.ArgumentParser(description="Draw the pictures of the documents anew.")
    parser.add_argument("names", nargs="*", help="files in docs/images; by default those that are stale")
    parser.add_argument("--all", action="store_true", help="draw also what is not stale")
    parser.add_argument("--real", type=Path, help="folder of recordings, as shared/data has them")
    args = parser.parse_args()
    known = manifest()
    for picture in catalog(args.real):
        if args.names and picture.name not in args.names:
            continue
        content = picture.make()
        now = fingerprint(picture.arrays(content))
        if not (args.all or args.names) and same(now, known.get(picture.name)) and (IMAGES / picture.name).exists():
            continue
        save(IMAGES / picture.name, picture.draw(content))
        known[picture.name] = now
        keep(known)


def catalog(recordings: Path | None) -> Iterator[DocPicture]:
    """All pictures; those of recorded people only where their folder is."""
    for module in (objects, people, senses, robots, policies, results):
        yield from module.pictures()
    if recordings is not None:
        yield from real.pictures(recordings)
        yield from robots.real_pictures(recordings)


def manifest() -> dict[str, Fingerprint]:
    """Name -> what it showed when it was drawn."""
    return read_json(MANIFEST) if MANIFEST.exists() else {}


def keep(known: dict[str, Fingerprint]) -> None:
    """Write the manifest, a line for each picture."""
    lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(found)}" for name, found in sorted(known.items()))
    write_atomic(MANIFEST, lambda out: out.write(f"{{\n{lines}\n}}\n".encode()))


def save(path: Path, image: np.ndarray) -> None:
    """Write a picture, small."""
    stream = io.BytesIO()
    if path.suffix == ".jpg":
        Image.fromarray(image).save(stream, "JPEG", quality=82, optimize=True)
    else:
        # colors by an octree: those by median cut lose what is small and bright
        few = Image.fromarray(image).quantize(COLORS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
        few.save(stream, "PNG", optimize=True)
    write_atomic(path, lambda out: out.write(stream.getvalue()))
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
