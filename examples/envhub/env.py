"""The six tasks for LeRobot, as an environment of its Hub: `make_env("<user>/<name>", trust_remote_code=True)`."""

from mimicbench.envs.lerobot.seen import make_env

__all__ = ["make_env"]
