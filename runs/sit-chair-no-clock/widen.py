"""A policy of ACT that did not see its last action, as one that does and pays no heed to it yet."""

import json
import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file, save_file

PLACE, JOINTS = 2 * 19 + 12 * 20, 19  # of the last action in S_current of the H1

source, target = map(Path, sys.argv[1:])
target.mkdir()
tensors = load_file(source / "model.safetensors")
for name in ("state_to_token.weight", "state_to_posterior.weight", "input_mean", "input_std"):
    # a target is about where its joint is
    filling = tensors[name][..., :JOINTS] * (0 if name.endswith("weight") else 1)
    tensors[name] = np.concatenate([tensors[name][..., :PLACE], filling, tensors[name][..., PLACE:]], -1)
save_file(tensors, target / "model.safetensors")
config = json.loads((source / "config.json").read_text())
config["config"]["inputs"]["last_action"] = True
(target / "config.json").write_text(json.dumps({k: v for k, v in config.items() if k not in ("model", "digest")}))
