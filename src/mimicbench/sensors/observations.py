"""What can be observed, by name: trackers, policies and Gymnasium all choose from these terms.

A term says how large it is for a robot and a task, and whether it is privileged: known to a simulator and to whoever
trains in it, but not to a robot's own senses. Only terms that somebody asks for are computed.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.errors import NotObserved, UnknownName
from mimicbench.robots.description import Robot
from mimicbench.sensors.contact import BEARING, told_to_bear
from mimicbench.sensors.context import StepContext
from mimicbench.sensors.elevation import camera_map, down_map
from mimicbench.sensors.heightmap import CELLS
from mimicbench.sensors.proprioception import body_state, gravity, link_state, s_current, tilt
from mimicbench.sensors.rays import FARTHEST, ray_depth
from mimicbench.sensors.reference import object_in_root, reference_in_root, reference_links, walk_of
from mimicbench.sensors.scene import gray, scene_in_root
from mimicbench.sensors.sight.views import CHANNELS, SIDE, views_now
from mimicbench.sensors.targets import target_map
from mimicbench.sensors.term import Term
from mimicbench.sim.threads import one_torch_thread
from mimicbench.tasks.task import BodyPoints, Task

LOOKAHEAD = (1, 2, 5, 10, 25)
"""Control steps ahead at which references can be observed: 0.02 s to 0.5 s."""


def _joints(times: int, more: int = 0) -> Callable[[Robot, Task], tuple[int, ...]]:
    return lambda robot, task: (times * len(robot.joints) + more,)


def _flat(size: int) -> Callable[[Robot, Task], tuple[int, ...]]:
    return lambda robot, task: (size,)


def _pictures(*more: int) -> Callable[[Robot, Task], tuple[int, ...]]:
    return lambda robot, task: (len(task.rig.mounts), -1, -1, *more)


def _map(robot: Robot, task: Task) -> tuple[int, ...]:
    return CELLS, CELLS


def _proprio(context: StepContext) -> Tensor:
    return body_state(context.state, context.root_turn)


def _joint_offset(context: StepContext) -> Tensor:
    return context.state.joint_pos - context.state.joint_pos.new_tensor(context.robot.rest_pose)


def _state(context: StepContext) -> Tensor:
    return s_current(context.state, context.links, context.last_target, context.root_turn)


def _body(context: StepContext) -> Tensor:
    return link_state(context.state, context.links, turn=context.root_turn)


def _body_target(context: StepContext) -> Tensor:
    frame = context.reference(1)
    links = reference_links(context.robot, frame)
    return link_state(context.state, links, frame.joint_pos, frame.joint_vel, context.root_turn)


def _body_difference(context: StepContext) -> Tensor:
    poses = slice(2 * len(context.robot.joints), 2 * len(context.robot.joints) + 6 * len(context.robot.links))
    return _body(context)[:, poses] - _body_target(context)[:, poses]


def _elevation(context: StepContext, ids: Tensor | None = None) -> Tensor:
    chosen = None if ids is None else ids.cpu().numpy()
    found = camera_map(
        context.physics, chosen, rig=context.task.rig, cell=context.task.map_cell, workers=context.physics.workers
    )
    return found.to(context.device)


def _heightmap(context: StepContext, ids: Tensor | None = None) -> Tensor:
    chosen = None if ids is None else ids.cpu().numpy()
    return down_map(context.physics, chosen, context.task.map_cell, context.physics.workers).to(context.device)


def _depth(context: StepContext) -> Tensor:
    size = context.pictures.height, context.pictures.width
    return torch.from_numpy(ray_depth(context.physics, None, *size, rig=context.task.rig)).to(context.device)


def _color(context: StepContext) -> Tensor:
    return torch.from_numpy(context.views.color).to(context.device)


def _labels(context: StepContext) -> Tensor:
    return torch.from_numpy(context.views.labels).to(context.device)


def _targets(context: StepContext) -> Tensor:
    links = context.links
    wrists = BodyPoints.of(context.robot, links.pos_w, links.quat_w).wrist_pos_w
    # a hand that has nothing to do is where it should be
    goal = torch.where(torch.isnan(context.wrist_goal_w), wrists, context.wrist_goal_w)
    away = (goal - context.state.root_pos_w[:, None]).float()
    return rot.rotate_inverse(context.state.root_quat_w[:, None], away)


def _root_pose(context: StepContext) -> Tensor:
    return torch.cat([context.state.root_pos_w, context.state.root_quat_w], 1)


def _target_elevation(context: StepContext) -> Tensor:
    pose = context.physics.qpos()[:, :7]
    goal = context.wrist_goal_w.cpu().numpy()
    return target_map(pose[:, :3], pose[:, 3:], goal, context.task.map_cell).to(context.device)


def _given(task: Task) -> bool:
    return task.wrist_goals


def _moves(task: Task) -> bool:
    return task.moves_object


def _ahead(steps: int) -> list[Term]:
    """What is `steps` control steps ahead in the reference."""
    return [
        Term(
            f"reference+{steps}",
            _joints(2, 12),
            lambda context: reference_in_root(context.state, context.reference(steps)),
            privileged=True,
        ),
        Term(
            f"object+{steps}",
            _flat(12),
            lambda context: object_in_root(context.state, context.reference(steps).object),
            privileged=True,
            exists=_moves,
            turns=(3,),
        ),
    ]


_TERMS = (
    Term("gravity", _flat(3), lambda context: gravity(context.state)),
    Term("tilt", _flat(2), lambda context: tilt(context.state)),
    Term("root_ang_vel", _flat(3), lambda context: context.state.root_ang_vel_b.clone()),
    Term("root_height", _flat(1), lambda context: context.state.root_pos_w[:, 2:].clone()),
    Term("joint_pos", _joints(1), lambda context: context.state.joint_pos.clone()),
    Term("joint_offset", _joints(1), _joint_offset),
    Term("joint_vel", _joints(1), lambda context: context.state.joint_vel.clone()),
    Term("proprio", _joints(2, 10), _proprio),
    Term("body", lambda robot, task: (2 * len(robot.joints) + 12 * len(robot.links),), _body),
    Term("state", lambda robot, task: (3 + 3 * len(robot.joints) + 12 * len(robot.links),), _state),
    Term("last_action", _joints(1), lambda context: context.last_action.clone()),
    Term("last_target", _joints(1), lambda context: context.last_target.clone()),
    Term("time", _flat(1), lambda context: context.time[:, None].clone(), low=0.0, high=3600.0),
    Term("odometry", _flat(3), lambda context: torch.cat([context.odometry_pos, context.odometry_yaw[:, None]], 1)),
    Term("elevation", _map, _elevation, some=_elevation),
    Term("gray", _map, lambda context: gray(_elevation(context)), low=0, high=255, dtype=torch.uint8),
    Term("heightmap", _map, _heightmap, some=_heightmap),
    Term("scene", _flat(12), scene_in_root, privileged=True),
    Term("target_elevation", _map, _target_elevation, exists=_given),
    Term("targets", lambda robot, task: (2, 3), _targets, exists=_given),
    Term("hands", _flat(2), lambda context: (~torch.isnan(context.wrist_goal_w).any(-1)).float(), exists=_given),
    Term("views", lambda robot, task: (CHANNELS, SIDE, SIDE), views_now, low=0.0, high=1.0),
    Term("depth", _pictures(), _depth, low=0.0, high=FARTHEST),
    Term("color", _pictures(3), _color, low=0, high=255, dtype=torch.uint8),
    Term("labels", _pictures(), _labels, low=0, high=255, dtype=torch.uint8),
    Term("root_pose", _flat(7), _root_pose, privileged=True),
    Term(
        "object",
        _flat(12),
        lambda context: object_in_root(context.state, context.object),
        privileged=True,
        exists=_moves,
        turns=(3,),
    ),
    Term(
        "body_target",
        lambda robot, task: (2 * len(robot.joints) + 12 * len(robot.links),),
        _body_target,
        privileged=True,
    ),
    Term("body_difference", lambda robot, task: (6 * len(robot.links),), _body_difference, privileged=True),
    Term("joint_target+1", _joints(1), lambda context: context.reference(1).joint_pos, privileged=True),
    Term("bears+1", _flat(len(BEARING)), lambda context: told_to_bear(context.reference(1)), privileged=True),
    Term("walk+1", _flat(3), lambda context: walk_of(context.reference(1)), privileged=True),
    *(term for steps in LOOKAHEAD for term in _ahead(steps)),
)
TERMS: Mapping[str, Term] = {term.name: term for term in _TERMS}
"""All terms by name. sensors.term says what each holds."""


def chosen_terms(names: Sequence[str | Term], task: Task) -> tuple[Term, ...]:
    """The terms of these names, or given as they are, that the task has. Raises UnknownName."""
    found = []
    for name in names:
        if not isinstance(name, Term) and name not in TERMS:
            raise UnknownName("observation", name, list(TERMS))
        found.append(name if isinstance(name, Term) else TERMS[name])
    return tuple(term for term in found if term.exists(task))


class Observations(Mapping[str, Tensor]):
    """What N robots observe at one control step: terms by name. All that a policy ever sees."""

    def __init__(self, values: Mapping[str, Tensor]) -> None:
        """`values` (N, *shape) of each term."""
        self._seen = dict(values)

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> "Observations":
        """Of arrays by the same names, as Gymnasium's vector environments give them."""
        return Observations({name: torch.from_numpy(np.ascontiguousarray(array)) for name, array in arrays.items()})

    def __getitem__(self, name: str) -> Tensor:
        if name not in self._seen:
            raise NotObserved(name)
        return self._seen[name]

    def of(self, name: str, ids: Tensor) -> Tensor:
        """(n, *shape) the term of robots `ids` (n,) alone."""
        return self[name][ids]

    def flat(self, names: Sequence[str]) -> Tensor:
        """(N, size) terms laid out one after the other."""
        return torch.cat([self[name].flatten(1) for name in names], -1)

    def __contains__(self, name: object) -> bool:
        return any(name == known for known in self)

    def __iter__(self) -> Iterator[str]:
        return iter(self._seen)

    def __len__(self) -> int:
        return len(self._seen)

    @property
    def num_envs(self) -> int:
        """N."""
        return len(next(iter(self._seen.values())))


class LazyObservations(Observations):
    """Terms of running episodes, computed when looked up, once."""

    def __init__(
        self,
        context: StepContext,
        names: Sequence[str | Term],
        noise: Callable[[str, Tensor], Tensor] | None = None,
    ) -> None:
        """`noise` gives back what a sensor would have measured instead of a term's true values (n, ...)."""
        super().__init__({})
        self._context, self._noise = context, noise
        self._terms = {term.name: term for term in chosen_terms(names, context.task)}

    @one_torch_thread
    def __getitem__(self, name: str) -> Tensor:
        if name not in self._seen:
            self._seen[name] = self._measured(name, self._term(name).compute(self._context))
        return self._seen[name]

    @one_torch_thread
    def of(self, name: str, ids: Tensor) -> Tensor:
        """(n, *shape) the term of robots `ids` (n,) alone."""
        term = self._term(name)
        if name in self._seen or term.some is None:
            return self[name][ids]
        return self._measured(name, term.some(self._context, ids))

    def __iter__(self) -> Iterator[str]:
        return iter(self._terms)

    def __len__(self) -> int:
        return len(self._terms)

    @property
    def num_envs(self) -> int:
        """N."""
        return self._context.num_envs

    def _term(self, name: str) -> Term:
        if name not in self._terms:
            raise NotObserved(name)
        return self._terms[name]

    def _measured(self, name: str, values: Tensor) -> Tensor:
        return values if self._noise is None else self._noise(name, values)
