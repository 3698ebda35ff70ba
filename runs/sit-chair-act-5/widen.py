"""ACT with wider feed-forward blocks and more decoder layers, whose answers are those of the one it is made of.

    python widen.py <folder of an act> <folder to write> <width of feed-forward blocks> <decoder layers>

New units of a block are heard with weight 0 (Net2Net, Chen et al. 2016). A new decoder layer follows the last one and
adds nothing to what it gets; its norms do not matter, since one norm follows that undoes them.
"""

import sys
from dataclasses import replace
from pathlib import Path

import torch

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.imitate.learners.act import ACTConfig

ADDS = ("attention.out.", "look.out.", "feedforward.3.")
"""Layers by which blocks add to what passes through them."""


def widen(source: Path, target: Path, width: int, layers: int) -> float:
    """Write it; the largest difference of an action [rad] on states and maps drawn at random."""
    one = load_checkpoint(source, "act")
    old = one.config_as(ACTConfig)
    torch.manual_seed(0)
    wide, narrow = replace(old, feedforward=width, decoder_layers=layers).build(), old.build()
    narrow.load_state_dict({name: torch.from_numpy(array).float() for name, array in one.tensors.items()})
    arrays = wide.state_dict()
    for name, known in narrow.state_dict().items():
        if arrays[name].shape == known.shape:
            arrays[name] = known
        elif name.endswith("feedforward.3.weight"):
            arrays[name][:, : old.feedforward], arrays[name][:, old.feedforward :] = known, 0
        else:
            arrays[name][: old.feedforward] = known
    for name, array in arrays.items():
        if name not in one.tensors and any(part in name for part in ADDS):
            array.zero_()
    wide.load_state_dict(arrays)
    states, maps = torch.randn(64, old.inputs.seen_size), torch.rand(64, 1, old.encoder.cells, old.encoder.cells)
    with torch.no_grad():
        differs = (narrow.eval().plan(states, maps) - wide.eval().plan(states, maps)).abs().max()
    save_checkpoint(target, "act", one.robot, wide.config, {k: v.numpy() for k, v in arrays.items()}, one.notes)
    return float(differs)


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    print(widen(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])))
