"""The command `mimicbench`: which commands there are."""

import faulthandler
import sys

import tyro

from mimicbench.commands import bench, judge, learn, objects, references, retarget
from mimicbench.core.errors import MimicbenchError

app = tyro.extras.SubcommandApp()
app.command(objects.app, name="objects", help="Make the task's objects, or import your own meshes.")
app.command(references.app, name="references", help="Make human clips on the objects, and what can be done with them.")
app.command(name="import")(references.import_)
app.command(retarget.app, name="retarget", help="Turn the human clips into robot clips, and compare the ways to do it.")
app.command(name="track")(learn.track)
app.command(name="demos")(learn.demos)
app.command(name="imitate")(learn.imitate)
app.command(name="evaluate")(judge.evaluate)
app.command(name="run")(judge.run)
app.command(name="table")(judge.table)
app.command(bench.app, name="bench", help="Measure how fast this machine is, and whether the world holds out.")


def main() -> None:
    """Run the command line; errors that the user can mend are printed in one sentence."""
    if sys.__stderr__ is not None:
        faulthandler.enable(sys.__stderr__)  # native code that crashes is to tell where
    try:
        app.cli(prog="mimicbench", description="Humanoid-scene interaction learned by mimicking humans.")
    except MimicbenchError as error:
        print(f"mimicbench: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("mimicbench: stopped; the same command goes on from here", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
