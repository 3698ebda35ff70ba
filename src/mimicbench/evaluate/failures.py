"""How episodes fail, in a few words that follow from their rows."""

from mimicbench.evaluate.rows import EpisodeRow

NEAR, REACH = 0.15, 0.5
"""[m] Who ends farther than this from what is sat or lain on was still on the way, or had lost it; or farther than this
from what is reached for, in front of which one stands: nine of ten who reach it do so from less than 0.43 m."""
FAILURES = (
    "fell walking",
    "fell turning",
    "fell at the object",
    "still on the way",
    "there, but not in place",
    "did not stay",
    "stopped by an error",
    "physics broke",
)
_FALLS = {"walking": FAILURES[0], "turning": FAILURES[1]}


def failure(row: EpisodeRow) -> str | None:
    """How an episode failed, one of FAILURES; None if it did not. Who fulfils K and does not stay has failed, too."""
    if row.error:
        return FAILURES[6]
    if row.diverged:
        return FAILURES[7]
    if row.success:
        return None if row.stays else FAILURES[5]
    if row.fell:
        return _FALLS.get(row.fell_phase, FAILURES[2])
    return FAILURES[3] if row.end_distance > (REACH if row.seat_height is None else NEAR) else FAILURES[4]
