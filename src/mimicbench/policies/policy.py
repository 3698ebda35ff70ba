"""What a policy is to whoever judges it or runs it."""

from mimicbench.envs.policy import Policy

__all__ = ["Policy"]
