"""Random numbers that depend on names, never on order or on the number of workers."""

import hashlib

import numpy as np


def rng(seed: int, *keys: str | int) -> np.random.Generator:
    """A generator for one named thing, such as the legs of chair-0-00042 under seed 0.

    Independent of every other name's.
    """
    return np.random.default_rng(digest(seed, *keys))


def digest(seed: int, *keys: str | int) -> int:
    """A 128-bit number from a seed and names, the same on every machine."""
    text = "\0".join(str(key) for key in (seed, *keys))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "little")
