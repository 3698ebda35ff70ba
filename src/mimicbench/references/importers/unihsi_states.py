"""Rigid-body states of UniHSI's humanoid, recorded from Isaac Gym."""

from mimicbench.references.importers.format import Format, Glimpse
from mimicbench.references.importers.unihsi import BODIES, STATE, STATE_NAMES, import_rigid_bodies


def recognizes(file: Glimpse) -> bool:
    """An array of every body's state, or an archive with one."""
    if file.content == "npy":
        return not file.pickled and file.shape[-2:] == (BODIES, STATE)
    if file.content == "zip" and file.array:
        return not file.pickled
    return file.content == "zip" and bool(file.names & set(STATE_NAMES))


FORMAT = Format("unihsi-states", import_rigid_bodies, recognizes)
