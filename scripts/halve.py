"""Write a checkpoint anew with its arrays in half precision, as it is shipped: half the bytes, read as any other.

    python scripts/halve.py <folder of a checkpoint> <folder to write>

Rates of what is shipped are of what it says here, so judge it afterwards.
"""

import sys
from pathlib import Path

import numpy as np

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint


def halve(source: Path, target: Path) -> float:
    """Write it; the largest change of a number, relative to the largest number of its array."""
    one = load_checkpoint(source)
    halves = {
        name: array.astype(np.float16) if array.dtype == np.float32 else array for name, array in one.tensors.items()
    }
    save_checkpoint(target, one.kind, one.robot, one.config, halves, {**one.notes, "arrays": "float16"})
    changes = (
        np.abs(halves[name] - array).max() / np.abs(array).max() for name, array in one.tensors.items() if array.any()
    )
    return float(max(changes))


def main() -> None:
    """Do it."""
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    print(f"largest relative change {halve(Path(sys.argv[1]), Path(sys.argv[2])):.1e}")


if __name__ == "__main__":
    main()
