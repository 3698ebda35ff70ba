"""Write the mean of checkpoints of one training: with the weights of several moments networks err less often.

    python scripts/average.py <folder of a checkpoint> ... <folder to write>

All must be of one kind and shape; configuration and notes are those of the last one. The folder to write may be one of
those that are read. Rates of what is shipped are of what it says here, so judge it afterwards.
"""

import sys
from pathlib import Path

import numpy as np

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint


def average(sources: list[Path], target: Path) -> None:
    """Write it. Exits where the checkpoints are not of one kind and shape."""
    all_of_them = [load_checkpoint(source) for source in sources]
    last = all_of_them[-1]
    shapes = {name: array.shape for name, array in last.tensors.items()}
    for one in all_of_them:
        if one.kind != last.kind or {name: array.shape for name, array in one.tensors.items()} != shapes:
            sys.exit(f"{one.folder} is not of the kind and shape of {last.folder}; give checkpoints of one training")
    mean = {
        name: np.mean([one.tensors[name].astype(np.float64) for one in all_of_them], axis=0).astype(array.dtype)
        for name, array in last.tensors.items()
    }
    save_checkpoint(target, last.kind, last.robot, last.config, mean, {**last.notes, "mean_of": len(sources)})


def main() -> None:
    """Do it."""
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    average([Path(source) for source in sys.argv[1:-1]], Path(sys.argv[-1]))


if __name__ == "__main__":
    main()
