"""An ACT policy that says the first frames of its chunk alone: `python shorten.py POLICY SHORTER FRAMES`."""

import sys
from dataclasses import replace
from pathlib import Path

from mimicbench.imitate.learned import load_learner, save_learner
from mimicbench.imitate.learners.act import ACTConfig
from mimicbench.robots.registry import ROBOTS


def main() -> None:
    """Read it, leave out the later frames, and write it."""
    given, notes = load_learner(Path(sys.argv[1]), ROBOTS.get("h1"), ACTConfig)
    frames, weights = int(sys.argv[3]), given.state_dict()
    weights["queries"] = weights["queries"][:, :frames]
    for name in ("action_mean", "action_std"):
        weights[name] = weights[name][:frames]
    shorter = replace(given.config, chunk=frames).build()
    shorter.load_state_dict(weights)
    save_learner(Path(sys.argv[2]), shorter, "h1", notes)


if __name__ == "__main__":
    main()
