"""Names that others gave, made safe to print and to use as a file's name."""

import hashlib
import re
import shlex

LONGEST = 80
"""Letters of a name that becomes part of an id."""


def printable(text: str, lines: bool = False) -> str:
    """The same with what could steer a terminal, or cannot be encoded, written out.

    It is one line, unless `lines` lets line ends pass.
    """
    return "".join(
        letter if letter.isprintable() or (lines and letter == "\n") else letter.encode("unicode_escape").decode()
        for letter in text
    )


def typed(place: object) -> str:
    """A path as it is typed in a shell: with blanks in it, in quotes."""
    return shlex.quote(str(place))


def safe_name(text: str) -> str:
    """The same of letters, digits, dots, hyphens and underscores alone, and at most LONGEST of them.

    A name that was cut off ends with some digits that tell it from others.
    """
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip(".-") or "unnamed"
    if len(name) <= LONGEST:
        return name
    digits = hashlib.blake2b(text.encode("utf-8", "surrogateescape"), digest_size=4).hexdigest()
    return f"{name[: LONGEST - 9]}-{digits}"
