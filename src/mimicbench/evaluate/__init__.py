"""The protocol: rollouts, one row per episode, K and P, intervals."""
