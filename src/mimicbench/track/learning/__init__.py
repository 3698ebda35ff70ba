"""How trackers learn: by PPO, or from teachers."""
