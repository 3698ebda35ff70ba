"""Let a clone see maps that cameras made: `python by_cameras.py <folder of its checkpoint> <folder to write>`."""

import sys
from pathlib import Path

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint

one = load_checkpoint(Path(sys.argv[1]))
config = {**one.config, "inputs": {**one.config["inputs"], "cameras": True}}
save_checkpoint(Path(sys.argv[2]), one.kind, one.robot, config, one.tensors, one.notes)
