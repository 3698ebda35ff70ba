"""N episodes of a task side by side, on tensors of the physics' device. Everything that learns or judges steps here.

    env = VecEnv(task, robot, objects, EnvConfig(), seed)
    env.reset(rows, states)         where and how episodes begin: see envs.initial_states
    env.step(target)                one control step of 0.02 s
    env.observe(["proprio", ...])   what the robots observe now, computed when looked up
    env.metrics                     K, P, falls, who stays

Nothing on a step's way is read back from the device. Whoever wants episodes that begin again by themselves resets those
that `track` or Gymnasium say are done.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import torch
from torch import Tensor

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.seeds import digest
from mimicbench.envs.hooks import Hook
from mimicbench.envs.initial_states import InitialStates
from mimicbench.envs.metrics import EpisodeMetrics, outside_of
from mimicbench.envs.reference import ReferenceBank
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sensors.context import Frame, StepContext, Transition
from mimicbench.sensors.observations import LazyObservations, Observations, Term
from mimicbench.sensors.pictures import CameraPictures
from mimicbench.sensors.proprioception import Odometry
from mimicbench.sim.backends import make_physics
from mimicbench.sim.physics import PhysicsConfig, RobotState
from mimicbench.sim.rows import Rows
from mimicbench.sim.threads import one_torch_thread
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task

REPORT_EVERY = 64
"""Control steps after which an asynchronous device is asked for scenes that broke."""


@dataclass(frozen=True)
class EnvConfig:
    """What environments are made of."""

    device: str = "cpu"
    """What computes the physics: `cpu`, `cuda`, `cuda:1` or `warp-cpu`."""
    workers: int = 0
    """Threads that step the physics on `cpu`, 0: all processors. Never changes a result."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """Gains, control, and what there is to be room for."""
    camera_size: tuple[int, int] = (90, 120)
    """Height and width of pictures [px]."""
    judged: bool = True
    """Keep metrics; without, steps are quicker."""
    measure_effort: bool = True
    """Measure the mechanical effort that P, and some rewards, need; without, steps are quicker."""
    noise: Mapping[str, float | tuple[float, ...]] = field(default_factory=dict)
    """Standard deviations of sensors' errors by the names of observations: of all numbers of one, or of each."""


class VecEnv:
    """N episodes. `reset` all of them before anything else."""

    def __init__(
        self,
        task: Task,
        robot: Robot,
        objects: Sequence[SceneObject],
        config: EnvConfig,
        seed: int = 0,
        bank: ReferenceBank | None = None,
        hooks: Sequence[Hook] = (),
    ) -> None:
        """Scenes of `robot`, one per object of `objects`; more may be added to `physics`' catalog.

        `bank` holds the clips that episodes follow, on the device of the tensors; `seed` decides what hooks and sensor
        noise draw.
        """
        self.task, self.robot, self.config, self.num_envs = task, robot, config, len(objects)
        self.measures_effort = config.measure_effort
        self.physics = make_physics(config.device, robot, objects, config.physics, config.workers)
        self.device = self.physics.device
        self.bank, self.hooks = bank, tuple(hooks)
        self.random = torch.Generator(self.device).manual_seed(digest(seed, "environment") % (1 << 63))
        """What hooks, noise and random starts draw from."""
        self.metrics = EpisodeMetrics(task, robot, self.physics, CONTROL_DT) if config.judged else None
        self.odometry = Odometry(self.num_envs, self.device)
        n, joints = self.num_envs, len(robot.joints)
        self.clip, self.index, self.steps = (torch.zeros(n, dtype=torch.long, device=self.device) for _ in range(3))
        """(N,) which clip each episode follows, at which of its frames it is, and control steps since it began."""
        self.wrist_goal_w = torch.full((n, 2, 3), torch.nan, device=self.device)
        self.last_target = torch.zeros(n, joints, device=self.device)
        self.last_action = torch.zeros(n, joints, device=self.device)
        self.applied = self.last_target
        """(N, J) what the joints were given in the last step, after all hooks."""
        self._pictures = CameraPictures(robot, task.rig, *config.camera_size)
        self._context: StepContext | None = None
        self._stepped = 0

    @property
    def context(self) -> StepContext:
        """Everything about now. Raises MimicbenchError before the first reset."""
        if self._context is None:
            raise MimicbenchError("no episode has begun; call reset() first")
        return self._context

    def rows(self, mask: Tensor) -> Rows:
        """The episodes in which `mask` (N,) is true, without asking an asynchronous device which they are."""
        return Rows.where(mask, whole=self.physics.asynchronous)

    @one_torch_thread
    def reset(self, rows: Rows, states: InitialStates) -> None:
        """Begin episodes `rows` anew, as n `states` say."""
        if not len(rows):
            return
        self.physics.set_objects(rows, states.object_index)
        self.physics.reset(rows, states.robot, states.object)
        for there, values in (
            (self.clip, states.clip),
            (self.index, states.frame),
            (self.steps, 0),
            (self.wrist_goal_w, states.wrist_goal_w),
            (self.last_target, 0.0),
            (self.last_action, 0.0),
        ):
            rows.put(there, values)
        for hook in self.hooks:
            hook.begin(self.physics, rows, self.random)
        state = self.physics.state()
        if self.metrics is not None:
            self.metrics.begin(rows, states.wrist_goal_w, state.root_pos_w)
        self.odometry.reset(rows, state)
        self._context = self._look(state)

    @one_torch_thread
    def step(self, target: Tensor, action: Tensor | None = None, running: Tensor | None = None) -> Transition:
        """One control step with joint targets (N, J) of the episodes `running` (N,) bool; the others stay as they are.

        `action` (N, J) is what the targets were made of, for who observes or rewards it; by default the targets.
        """
        before = self.context
        applied = target
        for hook in self.hooks:
            applied = hook.before_step(before, applied, self.random)
        self.applied = applied
        measured = self.measures_effort
        self.physics.step(applied, measured, running)
        action = target if action is None else action
        if running is None:
            # its own: a reset writes zeros into them, and the caller's are what learns from the step
            self.last_target, self.last_action = target.clone(), action.clone()
            self.index, self.steps = self.index + 1, self.steps + 1
        else:
            self.last_target = torch.where(running[:, None], target, self.last_target)
            self.last_action = torch.where(running[:, None], action, self.last_action)
            self.index, self.steps = self.index + running, self.steps + running
        state = self.physics.state()
        self.odometry.update(state, CONTROL_DT, running)
        self._context = self._look(state)
        if self.metrics is not None:
            self.metrics.update(self._context.links, running)
        self._stepped += 1
        if self._stepped % REPORT_EVERY == 0:
            self.physics.report()
        effort = self.physics.effort.float() if measured else torch.zeros(self.num_envs, device=self.device)
        return Transition(action, before, effort)

    def _look(self, state: RobotState | None = None) -> StepContext:
        """Everything about now; `state` is that of the physics, if it is at hand."""
        return StepContext(
            robot=self.robot,
            task=self.task,
            physics=self.physics,
            state=self.physics.state() if state is None else state,
            time=(self.steps.double() * CONTROL_DT).float(),
            odometry_pos=self.odometry.pos.clone(),
            odometry_yaw=self.odometry.yaw.clone(),
            last_action=self.last_action.clone(),
            last_target=self.last_target.clone(),
            wrist_goal_w=self.wrist_goal_w.clone(),
            reference=self._reference(),
            pictures=self._pictures,
        )

    def _reference(self) -> Callable[[int], Frame]:
        bank, clip, index = self.bank, self.clip.clone(), self.index.clone()
        if bank is None:
            return _no_reference
        frames: dict[int, Frame] = {}

        def reference(steps: int) -> Frame:
            if steps not in frames:
                frames[steps] = bank.frame(clip, index + steps)
            return frames[steps]

        return reference

    def observe(self, names: Sequence[str | Term]) -> Observations:
        """What all robots observe now, of the terms with these names."""
        return LazyObservations(self.context, names, self._noisy if self.config.noise else None)

    def _noisy(self, name: str, values: Tensor) -> Tensor:
        if name not in self.config.noise:
            return values
        deviation = torch.tensor(self.config.noise[name], device=self.device)
        return values + deviation * torch.randn(values.shape, generator=self.random, device=self.device)

    def root_distance(self) -> Tensor:
        """(N,) horizontal distance of each root from its object's bounding rectangle, wherever that is now [m]."""
        assert self.metrics is not None, "an environment that is not judged knows no bounds"
        info = self.metrics.info
        if self.physics.catalog[0].movable:
            obj = self.physics.object_state()
            info = info.moved(obj.pos_w.double(), obj.quat_w.double())
        return outside_of(self.context.state.root_pos_w.double(), info, torch)

    def state_tensors(self) -> dict[str, Tensor]:
        """All that decides how the episodes go on, between steps."""
        own = ("clip", "index", "steps", "wrist_goal_w", "last_target", "last_action")
        found = {name: getattr(self, name).clone() for name in own}
        found["random"] = self.random.get_state()
        parts = {"physics": self.physics, "odometry": self.odometry, "metrics": self.metrics}
        parts |= {f"hook{number}": hook for number, hook in enumerate(self.hooks)}
        for prefix, part in parts.items():
            if part is not None:
                found |= {f"{prefix}/{name}": value for name, value in part.state_tensors().items()}
        return found

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`, in an environment made alike, after a first reset."""
        parts = {"physics": self.physics, "odometry": self.odometry, "metrics": self.metrics}
        parts |= {f"hook{number}": hook for number, hook in enumerate(self.hooks)}
        for prefix, part in parts.items():
            chosen = {n.removeprefix(f"{prefix}/"): v for n, v in tensors.items() if n.startswith(f"{prefix}/")}
            if part is not None:
                part.load_state_tensors(chosen)
        for name in ("clip", "index", "steps", "wrist_goal_w", "last_target", "last_action"):
            setattr(self, name, tensors[name].to(self.device))
        self.random.set_state(tensors["random"].cpu())
        self._context = self._look()

    def close(self) -> None:
        """Tell of scenes that broke, and give the OpenGL context back if there is one."""
        self.physics.report()
        self._pictures.close()


def _no_reference(steps: int) -> Frame:
    raise MimicbenchError(
        "these episodes follow no clips, so there is no reference to observe; choose other observations"
    )
