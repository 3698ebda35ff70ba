"""Scenes whose physics broke: one sentence about each, and what it takes to run its last control step again.

A simulator that cannot go on (a number that is not finite, more contacts than there is room for) must end that scene,
never the run, and never in silence. Both backends keep the state before every control step, and hand it over here when
a scene breaks.
"""

import logging
import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from mimicbench.core.errors import BadFile
from mimicbench.core.files import read_npz, write_npz
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model
from mimicbench.sim.timing import SUBSTEPS

MAX_KEPT = 8
"""Broken scenes that a simulation writes to disk and tells of; further ones are only counted."""
_KIND = "broken_scene"
_ARRAYS = ("qpos", "qvel", "warmstart", "target", "wrench")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class BrokenScene:
    """A scene just before the control step in which it broke."""

    reason: str
    """What was found, for people."""
    scene: int
    """Its number in the batch."""
    backend: str
    """`native` or `warp`."""
    robot: str
    preset: str
    """Which of the robot's gains drove it."""
    control: str
    """`position`, `velocity` or `torque`."""
    obj: SceneObject
    qpos: np.ndarray
    """(nq,) MuJoCo's positions: root, joints, then the object's if it moves. What was not finite before the step is so
    here too."""
    qvel: np.ndarray
    """(nv,) MuJoCo's velocities."""
    warmstart: np.ndarray
    """(nv,) accelerations that the solver starts from, without which its last bits differ."""
    target: np.ndarray
    """(J,) targets of the control step."""
    wrench: np.ndarray
    """(6,) force [N] and torque [N m] on the root."""
    friction: float = 1.0
    """Times the sliding friction that everything has."""
    mass: float = 1.0
    """Times the mass and inertia that the robot's links have."""

    def save(self, path: Path) -> None:
        """Write it as an `.npz` that `load_broken` reads."""
        header = {
            "type": _KIND,
            "reason": self.reason,
            "scene": self.scene,
            "backend": self.backend,
            "robot": self.robot,
            "preset": self.preset,
            "control": self.control,
            "object": self.obj.to_dict(),
            "friction": self.friction,
            "mass": self.mass,
        }
        write_npz(path, header, {name: getattr(self, name) for name in _ARRAYS})


@dataclass(frozen=True)
class Replay:
    """A control step run again by MuJoCo itself, without the reset that it does on its own when numbers go bad."""

    qpos: np.ndarray
    """(SUBSTEPS, nq) positions after each physics step."""
    qvel: np.ndarray
    """(SUBSTEPS, nv) velocities after each physics step."""
    warnings: tuple[str, ...]
    """What MuJoCo warned of, such as `BADQACC`; empty if nothing broke this time."""


def load_broken(path: Path) -> BrokenScene:
    """Read a scene that `BrokenScene.save` wrote. Raises BadFile or BadObject."""
    header, arrays = read_npz(path, _KIND)
    obj = SceneObject.from_dict(header.get("object", {}))
    try:
        reason, backend, robot, preset, control = (
            str(header[name]) for name in ("reason", "backend", "robot", "preset", "control")
        )
        state = [np.asarray(arrays[name], float) for name in _ARRAYS]
        scaled = float(header["friction"]), float(header["mass"])
        return BrokenScene(reason, int(header["scene"]), backend, robot, preset, control, obj, *state, *scaled)
    except (KeyError, TypeError, ValueError) as error:
        raise BadFile(
            f"{path} is not a whole broken scene (it lacks {error}); let the simulation write it again"
        ) from None


def replay(broken: BrokenScene) -> Replay:
    """Run the control step in which a scene broke again, on one thread.

    A scene of the native backend goes the same way to the last bit. A scene of Warp, which computes with 32-bit
    numbers, may survive here: then the fault is in rounding, not in the scene. Raises BadFile if the state does not
    fit the robot and the object.
    """
    quiet()
    robot = ROBOTS.get(broken.robot)
    model = build_model(robot, broken.obj, broken.preset, broken.control, friction=broken.friction, mass=broken.mass)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    data = mujoco.MjData(model)
    for name, there in (
        ("qpos", data.qpos),
        ("qvel", data.qvel),
        ("warmstart", data.qacc_warmstart),
        ("target", data.ctrl),
        ("wrench", data.xfrc_applied[model.body(robot.link_names[0]).id]),
    ):
        given = getattr(broken, name)
        if given.shape != there.shape:
            raise BadFile(
                f"the broken scene's {name} is {given.shape}, but robot {broken.robot} and object "
                f"{broken.obj.id} need {there.shape}"
            )
        there[:] = given
    qpos, qvel = np.empty((SUBSTEPS, model.nq)), np.empty((SUBSTEPS, model.nv))
    for step in range(SUBSTEPS):
        mujoco.mj_step(model, data)
        qpos[step], qvel[step] = data.qpos, data.qvel
    kinds = (kind for name, kind in mujoco.mjtWarning.__members__.items() if name.startswith("mjWARN_"))
    return Replay(
        qpos, qvel, tuple(kind.name.removeprefix("mjWARN_") for kind in kinds if data.warning[kind.value].number)
    )


def quiet() -> None:
    """What MuJoCo warns of goes to the log, unless somebody else hears it: by itself it writes a file into the working
    folder, and a line for every scene and step.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.debug)


class BrokenLog:
    """Tells of broken scenes as they come, writes the first ones to disk, and counts all."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder` is where they go; None: a new folder among the temporary ones, made when it is needed."""
        quiet()
        self.folder = folder
        self.count = 0
        """Scenes that broke so far."""
        self.paths: list[Path] = []
        """Files of those that were written."""

    def add(self, broken: BrokenScene) -> None:
        """Report one broken scene."""
        self.count += 1
        told = f"scene {broken.scene} with object {broken.obj.id} was ended: {broken.reason}"
        if len(self.paths) < MAX_KEPT:
            try:
                self.folder = self.folder or Path(tempfile.mkdtemp(prefix="mimicbench-broken-"))
                path = self.folder / f"broken-{len(self.paths)}-scene-{broken.scene}.npz"
                broken.save(path)
            except OSError as error:  # a full disk ends no run
                _log.warning("%s; it could not be written: %s", told, error)
                return
            self.paths.append(path)
            _log.warning("%s; mimicbench.sim.broken.replay runs its last step again from %s", told, path)
        elif self.count & (self.count - 1) == 0:  # each power of two, so that a thousand of them stay readable
            _log.warning(
                "%s; it is number %d, and only the first %d were written to %s", told, self.count, MAX_KEPT, self.folder
            )
