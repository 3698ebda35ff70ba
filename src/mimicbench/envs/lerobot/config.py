"""What `lerobot-train` and `lerobot-eval` have to import to know the environment type `mimicbench`:
`--env.discover_packages_path=mimicbench.envs.lerobot --env.type=mimicbench --env.task=NAME`.

The only module that imports LeRobot, which mimicbench does not install.
"""

from dataclasses import dataclass, field
from typing import Any

import gymnasium
from lerobot.configs.types import FeatureType, PolicyFeature  # pyright: ignore[reportMissingImports]
from lerobot.envs.configs import EnvConfig  # pyright: ignore[reportMissingImports]

from mimicbench.envs.gym import TaskEnv
from mimicbench.envs.lerobot.seen import AsLeRobotSees, make_one
from mimicbench.tasks.registry import DEFAULT_TASK

ID = "mimicbench/LeRobot-v0"
"""What LeRobot makes, whatever the task."""
_NAMES = {
    "action": "action",
    "agent_pos": "observation.state",
    "environment_state": "observation.environment_state",
    "pixels/elevation": "observation.images.elevation",
}

if ID not in gymnasium.registry:
    # without wrappers of Gymnasium's own, behind which LeRobot would not find what the task is
    gymnasium.register(ID, make_one, order_enforce=False, disable_env_checker=True)


@EnvConfig.register_subclass("mimicbench")
@dataclass
class MimicbenchEnv(EnvConfig):
    """A task of the benchmark."""

    task: str | None = DEFAULT_TASK
    """Its name."""
    fps: int = round(TaskEnv.metadata["render_fps"])
    """Control steps a second."""
    split: str = "test"
    """Which objects to meet: `train`, `test` or `all`."""
    images: bool = False
    """Show the elevation map as a picture, as demonstrations with `demos.images` have it."""
    gains: str = "improved"
    """Which of the robot's gains drive its joints: `gains` in info.json of the demonstrations."""
    max_steps: int | None = None
    """Control steps to an episode's end; None: the task's time limit."""
    features_map: dict[str, str] = field(default_factory=lambda: dict(_NAMES))
    """LeRobot's names of what the environment gives and takes."""

    def __post_init__(self) -> None:
        """Say what there is, as LeRobot asks for it before it makes any environment."""
        env = make_one(self.task or DEFAULT_TASK, self.split, self.images)
        assert isinstance(env, AsLeRobotSees) and isinstance(env.observation_space, gymnasium.spaces.Dict)
        shapes = {name: space.shape for name, space in env.observation_space.items() if space.shape}
        kinds = {"agent_pos": FeatureType.STATE, "environment_state": FeatureType.ENV}
        self.features = {name: PolicyFeature(kinds[name], shapes[name]) for name in kinds}
        self.features["action"] = PolicyFeature(FeatureType.ACTION, env.action_space.shape or ())
        if self.images:
            pictures = env.observation_space["pixels"]
            assert isinstance(pictures, gymnasium.spaces.Dict)
            shape = pictures["elevation"].shape or ()
            self.features["pixels/elevation"] = PolicyFeature(FeatureType.VISUAL, shape)
        env.close()

    @property
    def package_name(self) -> str:
        """What makes the environment known."""
        return __name__

    @property
    def gym_id(self) -> str:
        """What Gymnasium knows it by."""
        return ID

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of `make_one`."""
        return {
            "task": self.task,
            "split": self.split,
            "images": self.images,
            "gains": self.gains,
            "max_steps": self.max_steps,
        }
