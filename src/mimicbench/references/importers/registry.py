"""All formats of human motion that can be imported, by name, and which of them a file is in."""

import io
import re
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from mimicbench.core.errors import BadFile, UnknownName
from mimicbench.core.untrusted import NPY, read_bytes
from mimicbench.references.importers.amass import BODIES, PLACES, ROOTS, import_amass
from mimicbench.references.importers.bvh import import_bvh
from mimicbench.references.importers.core4d import import_core4d
from mimicbench.references.importers.intermimic import import_intermimic
from mimicbench.references.importers.recording import MAX_BYTES, Recording, Wishes
from mimicbench.references.importers.roam import import_roam
from mimicbench.references.importers.unihsi import STATE_NAMES, import_rigid_bodies, import_skeleton_motion

FORMATS: dict[str, Callable[[Path, Wishes], Recording]] = {
    "unihsi": import_skeleton_motion,
    "unihsi-states": import_rigid_bodies,
    "roam": import_roam,
    "core4d": import_core4d,
    "amass": import_amass,
    "bvh": import_bvh,
    "intermimic": import_intermimic,
}


def import_recording(path: Path, form: str = "auto", wishes: Wishes | None = None) -> Recording:
    """Read one recording in a format of FORMATS, or in the one that it seems to be in.

    Raises BadFile, BadMotion or UnknownName.
    """
    if form != "auto" and form not in FORMATS:
        raise UnknownName("format", form, ["auto", *FORMATS])
    return FORMATS[detect_format(path) if form == "auto" else form](path, wishes or Wishes())


def detect_format(path: Path) -> str:
    """The format of a file, by its first bytes and its ending. Raises BadFile."""
    raw = read_bytes(path, MAX_BYTES)
    if raw.startswith(NPY):
        return _npy(raw)
    if raw.startswith(b"PK"):
        return _archive(path, raw)
    if path.suffix.lower() == ".bvh" or re.match(rb"(\xef\xbb\xbf)?\s*HIERARCHY", raw):
        return "bvh"
    if path.suffix.lower() in (".pt", ".pth"):
        return "intermimic"
    if path.suffix.lower() in (".npy", ".pkl", ".pickle"):
        return "unihsi"
    if path.suffix.lower() in (".txt", ".csv"):
        return "roam"
    raise BadFile(f"{path} is in none of the known formats ({', '.join(FORMATS)}); if it is, say in which (--format)")


def _npy(raw: bytes) -> str:
    """The format of an `.npy` file, by type and shape of its array."""
    header = raw[:400].decode("latin1")
    if re.search(r"'descr':\s*'\|?O", header):
        return "unihsi"
    shape = re.search(r"'shape':\s*\(([\d, ]*)\)", header)
    return "unihsi-states" if shape is not None and shape[1].replace(" ", "").rstrip(",").endswith(",15,13") else "roam"


def _archive(path: Path, raw: bytes) -> str:
    """The format of a zip archive, by the names in it."""
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            names = set(archive.namelist())
            first = archive.open("arr_0.npy").read(400) if "arr_0.npy" in names else b""
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError, NotImplementedError, EOFError, KeyError, zlib.error):
        raise BadFile(f"{path} cannot be read; it is a damaged archive: get it again") from None
    if any(name.endswith("data.pkl") for name in names):
        return "intermimic"
    found = {name.removesuffix(".npy") for name in names}
    if found & {"poses", *ROOTS, *BODIES} and found & set(PLACES):
        return "amass"
    if first:
        return "core4d" if re.search(rb"'descr':\s*'\|?O", first) else "unihsi-states"
    if found & set(STATE_NAMES):
        return "unihsi-states"
    if found & {"poses", *ROOTS, *BODIES}:
        return "amass"
    raise BadFile(
        f"{path} is an archive of {', '.join(sorted(names))[:100] or 'nothing'}, no known motion; say "
        "its format (--format)"
    )
