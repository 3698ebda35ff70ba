"""Errors that a user can act on."""

import os
import re
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

from mimicbench.core.names import printable

PACKAGE = str(Path(__file__).parents[1]) + os.sep
STANDARD = os.path.dirname(os.__file__) + os.sep
INSTALLED = re.compile(r"[\\/](site|dist)-packages[\\/]")


def guess(name: str, known: Iterable[str]) -> str:
    """The end of a message about a name that is not among those known: which one may be meant, if any is near."""
    lower = {one.lower(): one for one in known}
    meant = get_close_matches(name.lower(), lower, 1)
    return f"; did you mean {lower[meant[0]]!r}?" if meant else ""


class MimicbenchError(Exception):
    """Something the user can mend. The message is one sentence that says what to do next.

    The command line prints the message without a traceback and exits with status 2. Whatever names of files are in it,
    it is one line and steers no terminal.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


def told(error: BaseException) -> str:
    """What an exception of somebody else's program says, and on which line of which of their files it was raised."""
    import traceback  # not above: every command imports this

    own = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not INSTALLED.search(frame.filename) and not frame.filename.startswith((PACKAGE, STANDARD, "<frozen"))
    ]
    where = f" ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
    try:
        text = str(error)
    except Exception:
        text = ""  # who cannot even say what is wrong
    return f"{type(error).__name__}{f': {text}' if text else ''}{where}"


class BadFile(MimicbenchError):
    """A file is missing, cut off, too large, or holds something else than it should."""


class BadMotion(MimicbenchError):
    """A motion has NaN, no frames, another skeleton, or another robot than it should."""


class BadObject(MimicbenchError):
    """An object lacks what the task needs, such as a seat."""


class UnknownName(MimicbenchError):
    """A task, policy, robot or family that does not exist. The message lists those that do, with a guess."""

    def __init__(self, what: str, name: str, known: list[str]) -> None:
        super().__init__(what, name, known)  # as they are, so that the error can be sent from one process to another

    def __str__(self) -> str:
        what, name, known = self.args
        return f"unknown {what} {name!r}; known are: {', '.join(sorted(known))}{guess(str(name), known)}"


class NotObserved(MimicbenchError, KeyError):
    """An observation that is not there. Being a KeyError, it lets `get` of observations give its default."""

    def __init__(self, name: str) -> None:
        super().__init__(name)

    def __str__(self) -> str:
        name = printable(str(self.args[0]))
        return f"observation {name!r} was not asked for, or the task has none; name it among the policy's observations"


class WorkerDied(MimicbenchError):
    """A worker process was ended by the system or by a crash of native code."""
