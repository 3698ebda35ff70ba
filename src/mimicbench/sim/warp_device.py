"""Warp's devices, and programs on them."""

from collections.abc import Callable

import numpy as np
import torch
import warp as wp  # pyright: ignore[reportMissingImports]

from mimicbench.core.errors import MimicbenchError


def open_device(device: str) -> "wp.Device":
    """Warp's device, after a clear word if there is none."""
    wp.config.log_level = wp.LOG_WARNING
    if device != "cpu" and not torch.cuda.is_available():
        raise MimicbenchError(f"device {device} needs an NVIDIA GPU and the CUDA build of torch; use --device cpu")
    try:
        return wp.get_device(f"cuda:{torch.cuda.current_device()}" if device == "cuda" else device)
    except (ValueError, RuntimeError) as error:
        raise MimicbenchError(f"Warp has no device {device} ({error}); use --device cpu") from None


def program(device: "wp.Device", run: Callable[[], None]) -> Callable[[], None]:
    """What does `run` on a device: on a GPU as one captured graph, since launching its kernels one by one costs more
    than they do.
    """

    def there() -> None:
        with wp.ScopedDevice(device):
            run()

    there()  # compiles
    if not device.is_cuda:
        return there
    with wp.ScopedDevice(device), wp.ScopedCapture() as capture:
        run()
    graph = capture.graph
    assert graph is not None
    return lambda: wp.capture_launch(graph)


def read_only(values: torch.Tensor) -> np.ndarray:
    """A copy on the host, in double precision, that cannot be written to."""
    copy = values.double().cpu().numpy()
    copy.flags.writeable = False
    return copy
