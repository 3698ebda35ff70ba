"""A place to draw without a screen: EGL on Linux, what the platform has elsewhere."""

import atexit
import os
import sys
import weakref
from collections.abc import Callable, Sequence
from functools import cache
from types import TracebackType
from typing import Any, Self, TypeVar

import mujoco

from mimicbench.core.errors import MimicbenchError, WorkerDied
from mimicbench.core.parallel import map_items

_process: int | None = None
"""The process that OpenGL was first used in; a fork of it inherits this number."""
Item = TypeVar("Item")
Drawn = TypeVar("Drawn")

_ADVICE = "pictures and videos are left out (on Linux, install libegl1, or set MUJOCO_GL); everything else goes on"


class NoPictures(MimicbenchError):
    """There is no OpenGL to draw with. Everything but pictures and videos works all the same."""


def draw_apart(
    function: Callable[[Item], Drawn], items: Sequence[Item], workers: int, label: str, quiet: bool = False
) -> list[Drawn]:
    """`map_items` for a function that draws: in processes of their own, for graphics drivers crash, and then once more.

    Raises NoPictures if that crashes too.
    """
    for _ in range(2):
        try:
            return map_items(function, items, workers, label, quiet, isolated=True)
        except WorkerDied:
            pass
    raise NoPictures(
        "the graphics driver crashed twice; pictures and videos are left out (another one may be had "
        "with MUJOCO_GL); everything else goes on"
    )


class Canvas:
    """An off-screen buffer and one model's shapes and textures in it.

    Use as a context manager: GL contexts are few, and must be given back.
    """

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        """Open it for `model`, whose `vis.global_.offwidth` and `offheight` must be no smaller. Raises NoPictures."""
        _refuse_after_fork()
        context = None
        try:
            self._context = context = _context_class()(width, height)
            context.make_current()
            self.drawing = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self.drawing)
        except Exception as error:  # noqa: BLE001 every platform and driver fails in its own way, with its own exception
            if context is not None:
                context.free()
            raise NoPictures(f"there is no OpenGL to draw with ({type(error).__name__}: {error}); {_ADVICE}") from None
        _open_canvases().add(self)
        if self.drawing.offWidth < width or self.drawing.offHeight < height:
            self.close()
            raise NoPictures(f"OpenGL gives no off-screen buffer of {width}x{height}; {_ADVICE}")

    def make_current(self) -> None:
        """Let what is drawn next go here."""
        self._context.make_current()

    def close(self) -> None:
        """Give the GL context back."""
        _open_canvases().discard(self)
        self._context.make_current()
        self.drawing.free()
        self._context.free()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@cache
def _open_canvases() -> weakref.WeakSet[Canvas]:
    """Those that nobody has closed. At the end of the process they are, before MuJoCo ends EGL: it complains otherwise.

    First asked for when EGL is there, for what is to be done at the end is done in the reverse order.
    """
    canvases: weakref.WeakSet[Canvas] = weakref.WeakSet()

    def close_all() -> None:
        if os.getpid() == _process:  # in a fork, drivers hang
            for canvas in list(canvases):
                canvas.close()

    atexit.register(close_all)
    return canvases


def _refuse_after_fork() -> None:
    """Raises NoPictures in a process that was forked from one that has drawn: there, drivers hang."""
    global _process
    if _process is None:
        _process = os.getpid()
    if _process != os.getpid():
        raise NoPictures(
            "this process was forked from one that has used OpenGL, where graphics drivers hang; start workers by "
            'spawn, such as with vector_kwargs={"context": "spawn"}, or draw nothing before they are started'
        )


class SharedCanvas:
    """One canvas for the scenes of many models of one robot, drawn one after the other. Close it after use."""

    def __init__(self, height: int, width: int) -> None:
        self.height, self.width = height, width
        self._canvas: Canvas | None = None
        self._drawn: mujoco.MjModel | None = None

    def of(self, model: mujoco.MjModel) -> Canvas:
        """The canvas, ready to draw a model.

        It holds the textures, which all scenes share, and one model's meshes, which they do not. Raises NoPictures.
        """
        if (
            self._canvas is not None
            and self._drawn is not model
            and (model.nmesh or (self._drawn is not None and self._drawn.nmesh))
        ):
            self.close()
        if self._canvas is None:
            self._canvas, self._drawn = Canvas(model, self.height, self.width), model
        self._canvas.make_current()
        return self._canvas

    def close(self) -> None:
        """Give the GL context back; the next drawing opens another."""
        if self._canvas is not None:
            self._canvas.close()
        self._canvas = None


def _context_class() -> Any:
    """EGL on Linux unless MUJOCO_GL says otherwise, even when MuJoCo was imported before.

    Elsewhere MuJoCo's own choice.
    """
    if sys.platform.startswith("linux"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    backend = os.environ.get("MUJOCO_GL", "").strip().lower()
    if backend in ("disable", "disabled", "off", "false", "0"):
        raise RuntimeError(f"MUJOCO_GL is {backend!r}")
    if backend == "egl":
        from mujoco.egl import GLContext

        return GLContext
    return mujoco.GLContext
