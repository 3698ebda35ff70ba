"""The tracking environment: N robots, each following a clip next to the clip's object, over and over."""

from collections.abc import Mapping

import torch
from torch import Tensor

from mimicbench.core.seeds import digest
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.hooks import AssistingWrench, Hook, Pushes
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.sensors.context import StepContext
from mimicbench.sensors.observations import Observations
from mimicbench.sim.devices import tensor_device
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.rows import Rows
from mimicbench.sim.threads import one_torch_thread
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.failures import Failures
from mimicbench.track.history import History
from mimicbench.track.settings import ANYWHERE, EndConfig, TrackingConfig
from mimicbench.track.spec import TrackerSpec
from mimicbench.track.tracker import Layout

ENDS = ("position", "angle", "drop", "ankle", "object", "diverged", "clip over")
"""Why episodes of all trackers end; a design may add to them."""


class _Waiting:
    """Clips that stay where they are while the robot's joints are more than `LAG` from them, `LONGEST` steps of an
    episode at most, in some of the episodes. Nothing is drawn, and there is no state, where none may.
    """

    LAG = 0.14  # rad, root mean square over the joints
    LONGEST = round(3.0 / CONTROL_DT)

    def __init__(self, share: float, num_envs: int, device: str) -> None:
        self.share = share
        self.may = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.waited = torch.zeros(num_envs, dtype=torch.long, device=device)

    def begin(self, rows: Rows, random: torch.Generator) -> None:
        """Episodes begin."""
        if self.share:
            rows.put(self.may, torch.rand(len(rows), generator=random, device=self.may.device) < self.share)
            rows.put(self.waited, 0)

    def hold_back(self, env: VecEnv) -> None:
        """Before a step, which goes on by a frame, go back by one where the clip waits."""
        if self.share:
            behind = env.context.state.joint_pos - env.context.reference(0).joint_pos
            waits = behind.square().mean(-1).sqrt() > self.LAG
            waits &= self.may & (self.waited < self.LONGEST) & (env.index > 0)
            self.waited += waits
            env.index -= waits.long()

    def state_tensors(self) -> dict[str, Tensor]:
        """All that decides how it goes on."""
        return {"may": self.may.clone(), "waited": self.waited.clone()} if self.share else {}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        if self.share:
            self.may, self.waited = (tensors[name].to(self.may.device) for name in ("may", "waited"))


class TrackingEnv:
    """Steps all robots together; episodes that end start again at once, each with a clip and object drawn anew."""

    def __init__(
        self,
        spec: TrackerSpec,
        clips: ClipSet,
        num_envs: int,
        config: TrackingConfig,
        seed: int,
        env_config: EnvConfig | None = None,
        layout: Layout | None = None,
    ) -> None:
        """`env_config` says which device and how many threads; gains and metrics follow from the tracker.

        `layout` is that of its network, if it also follows clips of other tasks.
        """
        env_config = env_config or EnvConfig()
        self.spec, self.config, self.clips = spec, config, clips
        self.layout = layout or Layout.of(spec, clips.robot, [clips.task])
        device = tensor_device(env_config.device)
        self.bank = ReferenceBank(clips.motions, clips.robot, device)
        scenes = clips.scenes
        self.random = torch.Generator(device).manual_seed(digest(seed, "tracking starts") % (1 << 63))
        first = torch.randint(len(scenes), (num_envs,), generator=self.random, device=device).tolist()
        room = any(obj.hulls for obj in scenes)
        physics = PhysicsConfig(gains=spec.gains, meshes=room, measure_contact=spec.measures_contact)
        self._wrench = AssistingWrench(share=config.assist)
        hooks: list[Hook] = [Pushes(config.push, config.push_interval)] if config.push else []
        hooks += [self._wrench] if config.assist else []
        self.env = VecEnv(
            clips.task,
            clips.robot,
            [scenes[clip] for clip in first],
            EnvConfig(
                env_config.device, env_config.workers, physics, judged=config.fulfilled > 0.0, measure_effort=False
            ),
            seed,
            self.bank,
            hooks,
        )
        self.starts = ClipStarts(self.bank, self.env.physics.add_objects(scenes), clips.robot, config.starts)
        self.failures = Failures(device)
        self._hold = round(config.hold / CONTROL_DT)
        self._stepped = 0
        self.history = History(self.layout, num_envs, device)
        self.ends = (*ENDS, *spec.ends)
        """Why episodes end, in words."""
        self.ended = torch.zeros(len(self.ends), dtype=torch.long, device=device)
        """How many episodes ended for each of `ends`."""
        self._waiting = _Waiting(config.wait, num_envs, device)
        self._start(Rows.every(num_envs, device))

    @property
    def num_envs(self) -> int:
        """N."""
        return self.env.num_envs

    @property
    def device(self) -> str:
        """Where all tensors live."""
        return self.env.device

    @property
    def context(self) -> StepContext:
        """All robots now."""
        return self.env.context

    def terms(self) -> Observations:
        """What the tracker observes now, by name."""
        return self.env.observe(self.spec.observations)

    def observe(self) -> Tensor:
        """(N, F O) what the tracker observes now, after the frames before."""
        return self.history.seen(self.layout.flat(self.terms()))

    @one_torch_thread
    def step(
        self, action: Tensor, settings: object, target: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Apply actions (N, J).

        Args:
            action: (N, J) what the tracker gave.
            settings: of the tracker's reward and targets.
            target: (N, J) joint targets [rad] to apply, if not those that the action means on the clip's reference.

        Returns:
            observation (N, F O) after restarts, reward (N,), done (N,) bool, time_out (N,) bool: done because the clip
            is over, not because the robot failed.
        """
        if target is None:
            following = self.context.reference(1).joint_pos
            target = self.spec.aim(self.clips.robot, following, action, self.context.last_action, settings)
        if self.history.remembers:
            self.history.add(self.layout.flat(self.terms()))
        self.env.measures_effort = self.spec.measures_effort(settings)
        self._waiting.hold_back(self.env)
        transition = self.env.step(target, action)
        self._count(self._stepped + 1)
        reward = self.spec.reward(self.context, transition, settings)
        if self.env.metrics is not None:
            reward = reward + self.config.fulfilled * (self.env.metrics.run > 0)
        done, time_out = self._ends(settings)
        reward = torch.where(self.env.physics.diverged, torch.zeros_like(reward), reward)
        self._start(self.env.rows(done))
        return self.observe(), reward, done, time_out

    def _count(self, stepped: int) -> None:
        """So many control steps are over: the assistance has faded by as much."""
        self._stepped = stepped
        self._wrench.share = self.config.assist * max(0.0, 1.0 - stepped / self.config.assist_steps)

    def _ends(self, settings: object) -> tuple[Tensor, Tensor]:
        diverged, length = self.env.physics.diverged, self.bank.lengths[self.env.clip] - 1
        time_out = self.env.index >= length + self._hold
        failures = [*deviations(self.context, self.config.ends), diverged]
        own = [fails(self.context, settings) for fails in self.spec.ends.values()]
        self.ended = self.ended + torch.stack([flag.sum() for flag in (*failures, time_out, *own)])
        failed = torch.stack([*failures, *own]).any(0)
        self.failures.update(self.env.index / length.clamp(min=1), failed)
        return failed | time_out, time_out & ~failed

    def _start(self, rows: Rows) -> None:
        """Put robots on frames drawn at random, with noise, and exchange their objects."""
        self.history.begin(rows)
        if len(rows):
            self._waiting.begin(rows, self.random)
            self.env.reset(rows, self.starts.draw(len(rows), self.random, self.failures.chances(self.config.focus)))

    @property
    def _parts(self) -> dict[str, VecEnv | Failures | History | _Waiting]:
        """All that has a state of its own."""
        return {"env": self.env, "failures": self.failures, "history": self.history, "waiting": self._waiting}

    def state_tensors(self) -> dict[str, Tensor]:
        """All that decides how the episodes go on, between steps."""
        own = {"starts": self.random.get_state(), "ended": self.ended.clone(), "stepped": torch.tensor(self._stepped)}
        return own | {
            f"{name}/{key}": value for name, part in self._parts.items() for key, value in part.state_tensors().items()
        }

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`, in an environment made alike."""
        self.random.set_state(tensors["starts"].cpu())
        self.ended = tensors["ended"].to(self.device)
        self._count(int(tensors["stepped"]))
        for name, part in self._parts.items():
            chosen = {n.removeprefix(f"{name}/"): v for n, v in tensors.items() if n.startswith(f"{name}/")}
            part.load_state_tensors(chosen)


def deviations(context: StepContext, ends: EndConfig) -> tuple[Tensor, ...]:
    """Whether each root is too far from, too much turned from, too much below its reference; an ankle too far; the
    object too far.

    Each (N,) bool.
    """
    state, ref = context.state, context.reference(0)
    far = (state.root_pos_w - ref.root_pos_w).norm(dim=-1) > ends.max_pos_error
    turned = context.root_angle_error > ends.max_angle_error
    dropped = ref.root_pos_w[:, 2] - state.root_pos_w[:, 2] > ends.max_drop
    lost = left = torch.zeros_like(far)
    if ends.max_ankle_error < ANYWHERE:
        left = (context.body_points.ankle_pos_w - ref.ankle_pos_w).norm(dim=-1).amax(-1) > ends.max_ankle_error
    if context.task.moves_object:
        lost = (context.object.pos_w - ref.object.pos_w).norm(dim=-1) > ends.max_object_error
    return far, turned, dropped, left, lost
