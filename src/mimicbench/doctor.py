"""Whether this machine can do everything, and what to do where it cannot."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from mimicbench.core.parallel import cpu_count
from mimicbench.report.provenance import package_versions, this_machine

State = Literal["ok", "note", "fault"]
"""Fine; works, but there is something to know; something does not work."""
EXTRAS = {
    "train": (("rsl-rl-lib", "tensorboard"), "training trackers, and policies by PPO"),
    "view": (("viser", "mjviser"), "the page of `mimicbench view`"),
    "onnx": (("onnx", "onnxruntime", "onnxscript"), "policies as ONNX files"),
    "gpu": (("warp-lang", "mujoco-warp"), "physics on an NVIDIA GPU"),
    "bench": (("mink", "daqp"), "retargeting beside mink"),
}
"""Extra of the package -> what it installs, and what for."""
BAD_MUJOCO = "4.0.0"
"""Its sparse Newton solver is wrong."""
_OLDEST_PYTHON = (3, 11)
_SECONDS = 60
"""For drawing one picture; drivers that hang never return."""
_LITTLE_MEMORY, _LITTLE_DISK = 4.0, 5.0
"""[GiB] A training of a tracker takes 2 GiB and more, a whole run of a task some GiB of disk."""


@dataclass(frozen=True)
class Finding:
    """What was found of one thing."""

    name: str
    state: State
    found: str
    advice: str = ""
    """What to do; empty if nothing is to be done."""


def examine(folder: Path) -> list[Finding]:
    """Everything, in order; artefacts are to go to `folder` or below. Takes some seconds, for it draws a picture."""
    checks: tuple[Callable[[], list[Finding]], ...] = (
        python,
        packages,
        extras,
        threads,
        memory,
        lambda: disk(folder),
        pictures,
        gpu,
    )
    return [finding for check in checks for finding in check()]


def python() -> list[Finding]:
    """The interpreter."""
    found = sys.version.split()[0]
    if sys.version_info < _OLDEST_PYTHON:
        return [Finding("python", "fault", found, "install Python 3.11 or later, and mimicbench into it")]
    return [Finding("python", "ok", found)]


def packages() -> list[Finding]:
    """What results depend on."""
    found = []
    for name, version in package_versions().items():
        if name == "python" or any(name in names for names, _ in EXTRAS.values()):
            continue
        if version == "not installed":
            found.append(Finding(name, "fault", version, f"run `pip install {name}`, or install mimicbench again"))
        elif name == "mujoco" and version == BAD_MUJOCO:
            advice = "its solver is wrong: run `pip install 'mujoco!=4.0.0'`"
            found.append(Finding(name, "fault", version, advice))
        else:
            found.append(Finding(name, "ok", version))
    return found


def extras() -> list[Finding]:
    """What is not needed by all."""
    found = []
    for extra, (names, purpose) in EXTRAS.items():
        versions = [_version(name) for name in names]
        if all(versions):
            told = ", ".join(f"{name} {version}" for name, version in zip(names, versions, strict=True))
            found.append(Finding(f"[{extra}]", "ok", told))
        else:
            advice = f"for {purpose}: run `pip install 'mimicbench[{extra}]'`"
            found.append(Finding(f"[{extra}]", "note", "not installed", advice))
    return found


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def threads() -> list[Finding]:
    """Processors that this process may use."""
    usable, there = cpu_count(), os.cpu_count() or 1
    found = f"{usable} of {there} ({this_machine()['processor']})"
    if usable < there:
        advice = f"the system gives {usable}: stages use as many, or as many as --workers says"
        return [Finding("threads", "note", found, advice)]
    return [Finding("threads", "ok", found)]


def memory() -> list[Finding]:
    """What is free of it."""
    free = _free_memory()
    if free is None:
        return [Finding("memory", "note", "unknown", f"see to it that {_LITTLE_MEMORY:g} GiB are free")]
    found = f"{free:.1f} GiB free"
    if free < _LITTLE_MEMORY:
        advice = "close other programs, or train with fewer environments (`--track.num-envs`)"
        return [Finding("memory", "note", found, advice)]
    return [Finding("memory", "ok", found)]


def _free_memory() -> float | None:
    """[GiB], where Linux tells; None elsewhere."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    for line in lines:
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) / 2**20
    return None


def disk(folder: Path) -> list[Finding]:
    """What is free where artefacts go."""
    there = folder.resolve()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        return [Finding("disk", "fault", f"{there} is no folder", "give a folder with --workdir")]
    free = shutil.disk_usage(there).free / 2**30
    found = f"{free:.1f} GiB free at {folder}"
    if not os.access(there, os.W_OK):
        return [Finding("disk", "fault", f"{folder} cannot be written", "give another folder with --workdir")]
    if free < _LITTLE_DISK:
        return [Finding("disk", "note", found, "give a folder on a larger disk with --workdir")]
    return [Finding("disk", "ok", found)]


def pictures() -> list[Finding]:
    """Whether OpenGL draws: in a process of its own, for drivers crash and hang."""
    command = [sys.executable, "-c", "from mimicbench.doctor import draw; print(draw())"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_SECONDS, check=False)
        answer, failed = done.stdout.strip(), done.returncode != 0
        why = (done.stderr.strip().splitlines() or [f"it ended with status {done.returncode}"])[-1]
    except subprocess.TimeoutExpired:
        advice = "the machine may be busy: try again; if it stays so, OpenGL's driver hangs"
        return [Finding("pictures", "note", f"it did not answer within {_SECONDS} s", advice)]
    if failed:
        advice = "on Debian or Ubuntu: `apt install libegl1 libgl1-mesa-dri`; or set MUJOCO_GL to glfw or osmesa"
        return [Finding("pictures", "fault", why, f"{advice}; without, all works but pictures, videos and cameras")]
    if any(word in answer.lower() for word in ("llvmpipe", "softpipe", "swiftshader")):
        return [Finding("pictures", "note", answer, "drawn by the processor: on a GPU's own driver it is faster")]
    return [Finding("pictures", "ok", answer)]


def draw() -> str:
    """Draw a picture without a screen, and say what has drawn it. Raises NoPictures."""
    import mujoco

    from mimicbench.core.errors import MimicbenchError
    from mimicbench.drawing.opengl import Canvas

    side = 32
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.3, 0, 0])
    spec.worldbody.add_light(pos=[0, 0, 3])
    model = spec.compile()
    model.vis.global_.offheight = model.vis.global_.offwidth = side
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Canvas(model, side, side) as canvas:
        from OpenGL import GL

        scene, camera = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
        camera.distance = 1.0
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene)
        rect = mujoco.MjrRect(0, 0, side, side)
        mujoco.mjr_render(rect, scene, canvas.drawing)
        import numpy as np

        pixels = np.zeros((side, side, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, rect, canvas.drawing)
        drawn_by = GL.glGetString(GL.GL_RENDERER)
    if not pixels.any():
        raise MimicbenchError("OpenGL draws nothing but black")
    name = drawn_by.decode() if isinstance(drawn_by, bytes) else str(drawn_by)
    return f"{os.environ.get('MUJOCO_GL', 'its own choice')}: {name}"


def gpu() -> list[Finding]:
    """Whether there is one, for torch and for physics."""
    try:
        import torch
    except ModuleNotFoundError:
        return [Finding("gpu", "fault", "torch is not installed", "run `pip install torch`")]
    if torch.cuda.is_available():
        names = ", ".join(torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count()))
        if _version("mujoco-warp") is None:
            advice = "run `pip install 'mimicbench[gpu]'`, then add --device cuda"
            return [Finding("gpu", "note", f"{names}, without MuJoCo Warp", advice)]
        return [Finding("gpu", "ok", f"{names}: use it with --device cuda")]
    if shutil.which("nvidia-smi"):
        advice = "install torch's CUDA build: `pip install torch --index-url https://download.pytorch.org/whl/cu128`"
        return [Finding("gpu", "note", f"torch {torch.__version__} sees none", advice)]
    return [Finding("gpu", "ok", "none: physics and networks run on the processor")]
