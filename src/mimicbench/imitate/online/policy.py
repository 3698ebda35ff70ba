"""Who plans online, in closed loop."""

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor, nn

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import beside, load_checkpoint, save_checkpoint
from mimicbench.envs.reference import Laid, ReferenceBank, lay
from mimicbench.imitate.goals import KnownGoal, known_goal
from mimicbench.imitate.learners.online import OnlineConfig
from mimicbench.imitate.online.planning import (
    WALKS,
    Begin,
    Planned,
    Planning,
    from_plan,
    from_standing,
    from_walking,
    numbers_of,
    standing,
)
from mimicbench.imitate.online.reckoning import in_hands, reckoned, risen, seen_from
from mimicbench.imitate.online.rehearsal import choose
from mimicbench.imitate.plan import Imagined
from mimicbench.imitate.planner import own_terms
from mimicbench.imitate.policy import BODY
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations, chosen_terms
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.history import Follower
from mimicbench.track.tracker import Tracker


class OnlinePolicy:
    """Plans at the start; from then on the tracker follows, and the plan goes where the goal is.

    Who may plan anew does so when it comes nearer and sees that the goal is not what the plan was made for: from what
    the person in mind does at that moment, so that feet go on as they were going.
    """

    def __init__(self, robot: Robot, task: Task, tracker: Tracker, goal: KnownGoal, config: OnlineConfig) -> None:
        self._robot, self._task, self._tracker, self._goal, self._config = robot, task, tracker, goal, config
        self._planning, self._own = Planning(robot, task, config), own_terms(tracker.spec, task)
        self._told = tuple(term for term in chosen_terms(tracker.spec.observations, task) if term.privileged)
        self.gains = tracker.spec.gains
        self.observations: tuple[str, ...] = tuple(dict.fromkeys((*BODY, *goal.observations, "elevation", *self._own)))
        self._device = "cpu"
        self._forget(0)

    def _forget(self, robots: int) -> None:
        self._plans: list[Laid | None] = [None] * robots
        self._minds: list[Planned | None] = [None] * robots
        """The people in mind; None for who has no plan."""
        self._numbers, self._begins = [0] * robots, torch.zeros(robots, dtype=torch.long, device=self._device)
        """Number of each plan's styles, and (N,) the control step at which it began."""
        self._planned_for = torch.zeros(robots, self._task.goal.size, device=self._device)
        """(N, G) the goals that plans were made for."""
        self._place = torch.zeros(robots, 3, device=self._device)
        """(N, 3) where each plan is: x, y [m] and yaw [rad] in the heading frame of the start."""
        self._last_action = torch.zeros(robots, len(self._robot.joints), device=self._device)
        self._follower = Follower(self._tracker, robots, self._device)
        self._bank: ReferenceBank | None = None

    def to(self, device: str) -> None:
        """Move the networks to a device; nothing is remembered."""
        self._device = device
        self._tracker.network.to(device)
        self._goal.to(device)
        self._forget(0)

    def networks(self) -> list[nn.Module]:
        """All that it runs on."""
        return [self._tracker.network, *self._goal.networks()]

    @torch.no_grad()
    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Find out about the goal, and plan."""
        if len(self._plans) != obs.num_envs:
            self._forget(obs.num_envs)
        self._goal.begin(ids, obs)
        here = seen_from(reckoned(obs["proprio"], obs["odometry"]), self._wanted())
        stands = torch.cat([here.root_pos_w[:, :2], rot.yaw_of(here.root_quat_w)[:, None]], -1).double().cpu().numpy()
        joint_pos, walks = here.joint_pos.double().cpu().numpy(), here.root_lin_vel_w[:, :2].norm(dim=-1) > WALKS
        begins = {
            i: from_walking(self._robot, here, i) if walks[i] else from_standing(self._robot, stands[i], joint_pos[i])
            for i in ids.tolist()
        }
        numbers = numbers_of(self._goal.goal, here.joint_pos)
        for i in begins:
            self._plans[i], self._minds[i] = lay(standing(self._robot, self._task, here, i), self._robot), None
            self._numbers[i] = numbers[i]
        self._plan(begins, obs)
        # who could plan nothing does not try again at every step
        self._planned_for = self._planned_for.index_copy(0, ids, self._goal.goal[ids])
        self._place = self._place.index_copy(0, ids, self._wanted()[ids])
        self._begins = self._begins.index_fill(0, ids, 0)
        self._last_action = self._last_action.index_fill(0, ids, 0.0)
        self._follower.history.begin(Rows.of(ids, obs.num_envs, self._device))

    @torch.no_grad()
    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad]."""
        robots = torch.arange(obs.num_envs, device=self._device)
        self._goal.recall(obs)
        step = (obs["time"][:, 0] / CONTROL_DT).round().long()
        self._plan_anew(step, obs)
        self._go_along()
        bank, index = self._bank, step - self._begins
        assert bank is not None, "reset it first"
        state = seen_from(reckoned(obs["proprio"], obs["odometry"]), self._place)
        context = Imagined.of(self._robot, self._task, state, lambda ahead: bank.frame(robots, index + ahead))
        if self._task.moves_object:
            context = context.beside(in_hands(context))
        told = {term.name: term.compute(context) for term in self._told}
        terms = {**{name: obs[name] for name in self._own}, "last_action": self._last_action, **told}
        self._last_action, self._before = self._follower.action(terms), terms
        return self._tracker.target(self._robot, terms, self._last_action)

    def drove(self, target: Tensor) -> None:
        """Joint targets (N, J) [rad] were given instead of what `act` said last: it goes on from there."""
        self._last_action = self._tracker.actions_of(self._robot, self._before, target)

    def _plan(self, begins: Mapping[int, Begin], obs: Observations) -> list[int]:
        """Robots plan with what they know of their goals; who succeeded."""
        spec, ids = self._task.goal, torch.tensor(list(begins), device=self._device)
        wanted, odometry = self._wanted(), obs["odometry"][ids]
        own = spec.to_root(self._goal.goal, wanted[:, :2], wanted[:, 2]).double().cpu().numpy()
        near = spec.place(spec.to_root(self._goal.goal[ids], odometry[:, :2], odometry[:, 2]))
        around = risen(obs.of("elevation", ids), obs["proprio"][ids, 3], near, self._task.map_cell)
        found: dict[int, list[Planned]] = {}
        for near_it, (i, begin) in zip(around, begins.items(), strict=True):
            found[i] = self._planning.plans(own[i], near_it, begin, self._numbers[i])
        done = [i for i, plans in found.items() if plans]
        plans, most = [found[i] for i in done], self._config.room
        chosen = choose(self._tracker, self._robot, self._task, plans, most, self._device)
        for i, planned in zip(done, chosen, strict=True):
            self._plans[i], self._minds[i] = lay(planned.motion, self._robot), planned
        known = next(plan for plan in self._plans if plan is not None)
        self._bank = ReferenceBank([plan or known for plan in self._plans], self._robot, self._device)
        return done

    def _plan_anew(self, step: Tensor, obs: Observations) -> None:
        """Who knows by now that the goal is not what the plan was made for makes another one."""
        if not self._config.anew:
            return
        spec, goal = self._task.goal, self._goal.goal
        off = torch.stack(list(spec.errors(goal, self._planned_for).values())).amax(0)
        due = [i for i in (off > self._config.anew).nonzero()[:, 0].tolist() if self._minds[i] is not None]
        if not due:
            return
        wanted, begins = self._wanted(), {}
        turn = self._place[:, 2] - wanted[:, 2]
        away = rot.rotate(rot.from_yaw(-wanted[:, 2]), self._place - wanted)
        moved = torch.cat([away[:, :2], turn[:, None]], -1).double().cpu().numpy()
        for i in due:
            before = self._minds[i]
            assert before is not None
            begins[i] = from_plan(before, float(step[i] - self._begins[i]) * CONTROL_DT, moved[i])
        done = torch.tensor(self._plan(begins, obs), dtype=torch.long, device=self._device)
        tried = torch.tensor(due, device=self._device)
        self._planned_for = self._planned_for.index_copy(0, tried, goal[tried])
        self._place = self._place.index_copy(0, done, wanted[done])
        self._begins = self._begins.index_copy(0, done, step[done])

    def _wanted(self) -> Tensor:
        """(N, 3) x, y [m] and yaw [rad] of the goals as they are known."""
        return self._task.goal.place(self._goal.goal)

    def _go_along(self) -> None:
        """Plans move to where their goals are known to be by now."""
        away, most = self._wanted() - self._place, self._config.pace * CONTROL_DT
        away[:, 2] = rot.wrap_angle(away[:, 2])
        far = away[:, :2].norm(dim=-1, keepdim=True).clamp(min=1e-9)
        step = away[:, :2] * (most / far).clamp(max=1.0)
        self._place = self._place + torch.cat([step, away[:, 2:].clamp(-2 * most, 2 * most)], -1)


def save_online(folder: Path, robot: Robot, config: OnlineConfig, notes: Mapping[str, object]) -> None:
    """Write how to plan; tracker and perception are in folders beside it."""
    save_checkpoint(folder, "online", robot.name, config, {}, notes)


def load_online(folder: Path, robot: Robot, task: Task) -> OnlinePolicy:
    """Read one with the `tracker` and the `perception` in the folders beside it. Raises BadCheckpoint."""
    config = load_checkpoint(folder, "online", robot.name).config_as(OnlineConfig)
    tracker = load_tracker(beside(folder, "tracker"), robot)
    return OnlinePolicy(robot, task, tracker, known_goal(beside(folder, "perception"), robot, task), config)
