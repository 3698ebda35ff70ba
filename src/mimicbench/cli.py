"""The command `mimicbench`: which commands there are, and what becomes of errors and signals."""

import errno
import faulthandler
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from types import FrameType
from typing import NoReturn

from mimicbench import __version__
from mimicbench.core.errors import MimicbenchError, guess
from mimicbench.core.names import printable

STOPPED = "stopped; the same command goes on from here"
WATCHED = ("view", "table", "doctor", "bench", "export")
"""Commands that make nothing in a workdir."""


@dataclass(frozen=True)
class Command:
    """A command, whose module is imported only when it is called."""

    help: str
    module: str
    """In mimicbench.commands."""
    function: str
    recipe: bool = False
    """Whether the function reads its arguments itself, as a recipe."""


COMMANDS = {
    "objects": Command("Make the task's objects.", "stages", "objects", True),
    "objects draw": Command("Draw objects on one sheet.", "objects", "draw"),
    "objects import": Command("Make objects of your own meshes.", "objects", "import_"),
    "references": Command("Make human clips on the objects.", "stages", "references", True),
    "references augment": Command("Make variants of clips.", "references", "augment"),
    "references remake": Command("Make one clip again from its id.", "references", "remake"),
    "references stats": Command("Measure the clips beside the paper's.", "references", "stats"),
    "import": Command("Import recordings of real people.", "references", "import_"),
    "retarget": Command("Turn the human clips into robot clips.", "stages", "retarget", True),
    "retarget draw": Command("Draw robot clips beside their people.", "retarget", "draw"),
    "retarget compare": Command("Compare the ways to retarget.", "retarget", "compare"),
    "track": Command("Train a tracker on the robot clips.", "stages", "track", True),
    "demos": Command("Let the tracker make demonstrations.", "stages", "demos", True),
    "demos verify": Command("Find K again in stored demonstrations.", "stages", "verify", True),
    "imitate": Command("Learn a policy that sees.", "stages", "imitate", True),
    "evaluate": Command("Judge policies and trackers.", "judge", "evaluate", True),
    "run": Command("Do the whole task, and report on it.", "judge", "run", True),
    "compare": Command("Learn and judge recipes side by side.", "compare", "compare", True),
    "compare list": Command("Say which comparisons there are.", "compare", "list_"),
    "export policy": Command("Write a policy as an ONNX file.", "export_policy", "export_policy"),
    "export scene": Command("Write a robot and an object as MJCF.", "export", "scene"),
    "export motion": Command("Write a clip for BeyondMimic and mjlab.", "export", "motion"),
    "view": Command("Look at everything in the browser.", "view", "view"),
    "table": Command("Print results beside the paper's.", "table", "table"),
    "table list": Command("Say which tables there are.", "table", "list_"),
    "doctor": Command("Say whether this machine can do everything.", "doctor", "doctor"),
    "bench": Command("Measure how fast this machine is.", "bench", "stages"),
    "bench retarget": Command("Measure every way to retarget.", "bench", "retarget"),
    "bench world": Command("Measure the environments of all tasks.", "bench", "world"),
    "bench maps": Command("Measure elevation maps, beside the physics.", "bench", "maps"),
    "bench imitate": Command("Measure how fast learners learn and decide.", "bench", "imitate"),
    "bench robust": Command("Find out what a tracker survives.", "bench", "robust"),
    "bench soak": Command("Find out whether the world holds out.", "bench", "soak"),
}
NO_ACCESS, IO_ERROR = 77, 74
"""Exit statuses of errors of the system (sysexits.h)."""


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line; errors that the user can mend are printed in one sentence."""
    if sys.__stderr__ is not None:
        faulthandler.enable(sys.__stderr__)  # native code that crashes is to tell where
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _interrupt)
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        _call(words)
        sys.stdout.flush()
    except MimicbenchError as error:
        _leave(2, str(error))
    except KeyboardInterrupt as stop:
        number = stop.args[0] if stop.args else signal.SIGINT
        _leave(128 + int(number), "stopped" if words[:1] and words[0] in WATCHED else STOPPED)
    except ImportError as error:
        # native modules that are stopped while they load make another error of it
        if not (stops := [part for part in _behind(error) if isinstance(part, KeyboardInterrupt)]):
            raise
        _leave(128 + int((stops[0].args or (signal.SIGINT,))[0]), STOPPED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes stdout once more at its end
        sys.exit(128 + signal.SIGPIPE)
    except OSError as error:
        place = f" ({error.filename})" if error.filename else ""
        status = NO_ACCESS if error.errno in (errno.EACCES, errno.EPERM) else IO_ERROR
        _leave(status, f"{error.strerror or error}{place}; mend that, and the same command goes on from here")


def _call(words: list[str]) -> None:
    if not words or words[0] in ("-h", "--help"):
        print(overview())
        return
    if words[0] == "--version":
        print(f"mimicbench {__version__}")
        return
    if words[0] == "--completion":
        from mimicbench.commands.completion import script

        print(script(COMMANDS))
        return
    name = " ".join(words[:2]) if " ".join(words[:2]) in COMMANDS else words[0]
    if name not in COMMANDS:
        known = ", ".join(COMMANDS)
        raise MimicbenchError(f"there is no command {name!r}; there are: {known}{guess(name, COMMANDS)}")
    command, rest = COMMANDS[name], words[len(name.split()) :]
    function = getattr(import_module(f"mimicbench.commands.{command.module}"), command.function)
    if command.recipe:
        function(rest)
        return
    import tyro

    from mimicbench.commands.options import checked

    tyro.cli(checked(function), args=rest, prog=f"mimicbench {name}")


def overview() -> str:
    """What `mimicbench --help` prints. Imports nothing, so that it comes at once."""
    width = max(len(name) for name in COMMANDS)
    lines = [f"  {name:<{width}}  {command.help}" for name, command in COMMANDS.items()]
    return "\n".join(
        [
            "usage: mimicbench COMMAND [OPTIONS]",
            "",
            "Humanoid-scene interaction learned by mimicking humans.",
            "",
            *lines,
            "",
            "`mimicbench COMMAND --help` has every setting; `mimicbench --version` the version;",
            '`eval "$(mimicbench --completion)"` lets bash and zsh complete all of them.',
        ]
    )


def _behind(error: BaseException | None) -> Iterator[BaseException]:
    """An error, and those that it came from."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt(number)


def _leave(status: int, message: str) -> NoReturn:
    print(f"mimicbench: {printable(message)}", file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
