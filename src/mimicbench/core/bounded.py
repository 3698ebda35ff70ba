"""Calls in a process of their own, with limits on memory and time, for work on input that nobody vouches for.

The other process gets arrays on its standard input and gives arrays back; neither side ever unpickles. If it crashes,
hangs, or asks for too much memory, the caller gets one clear sentence.
"""

import importlib
import io
import os
import resource
import signal
import subprocess
import sys
import zipfile
from collections.abc import Mapping

import numpy as np

from mimicbench.core.errors import BadFile, MimicbenchError

PATIENCE = 3.0
_OUT_OF_MEMORY, _FAILED = 3, 4


def run_bounded(
    module: str, function: str, arrays: Mapping[str, np.ndarray], seconds: float, memory: int, blame: str
) -> dict[str, np.ndarray]:
    """Call `module.function(**arrays)`, which returns a dict of arrays, in another process.

    Args:
        module: full name of the module.
        function: name of the function in it.
        arrays: its arguments; plain arrays, no objects.
        seconds: processor time that it may take; by the clock it may take PATIENCE times as long, on a busy machine.
        memory: address space that it may take [bytes].
        blame: start of the sentence if it fails, such as `chair.obj cannot be read: `.

    Raises:
        BadFile: it failed, crashed, or took too long or too much memory.
    """
    stream = io.BytesIO()
    np.savez(stream, **dict(arrays))  # pyright: ignore[reportArgumentType]
    one_thread = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    try:
        # -P: modules of the folder that the user is in are none of ours
        done = subprocess.run(
            [
                sys.executable,
                "-P",
                "-m",
                "mimicbench.core.bounded",
                module,
                function,
                str(max(1, round(seconds))),
                str(memory),
            ],
            input=stream.getvalue(),
            capture_output=True,
            timeout=PATIENCE * seconds,
            check=False,
            env={**os.environ, **one_thread},
        )
    except subprocess.TimeoutExpired:
        raise BadFile(f"{blame}it takes more than {seconds:.0f} s") from None
    if done.returncode == 0:
        try:
            with np.load(io.BytesIO(done.stdout), allow_pickle=False) as found:
                return {name: found[name] for name in found.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            raise BadFile(f"{blame}what came back from it is damaged") from None
    if done.returncode == -signal.SIGXCPU:
        raise BadFile(f"{blame}it takes more than {seconds:.0f} s")
    if done.returncode == _OUT_OF_MEMORY:
        raise BadFile(f"{blame}it takes more than {memory >> 20} MiB of memory")
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    reason = lines[-1] if done.returncode == _FAILED and lines else f"it ended with status {done.returncode}"
    raise BadFile(blame + reason[:200])


def _main() -> int:
    """The other process."""
    module, function, seconds, memory = sys.argv[1:5]
    answer = os.dup(1)
    os.dup2(2, 1)  # libraries that print must not mix with the answer
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
    resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as given:
            arrays = {name: given[name] for name in given.files}
        found = getattr(importlib.import_module(module), function)(**arrays)
        stream = io.BytesIO()
        np.savez(stream, **found)
        with os.fdopen(answer, "wb") as out:
            out.write(stream.getbuffer())
    except MemoryError:
        return _OUT_OF_MEMORY
    except MimicbenchError as error:
        print(error, file=sys.stderr)
        return _FAILED
    except Exception as error:  # whatever a parser trips over is the input's fault
        text = " ".join(str(error).split())
        print(f"{type(error).__name__}: {text}" if text else type(error).__name__, file=sys.stderr)
        return _FAILED
    return 0


if __name__ == "__main__":
    status = _main()
    sys.stderr.flush()
    os._exit(status)  # nothing that a library registered runs after the answer
