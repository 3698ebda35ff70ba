"""`mimicbench view`: a page in the browser on everything that a workdir holds."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import tyro

from mimicbench.commands.options import WORK, Workdir
from mimicbench.core.settings import Within
from mimicbench.tasks.registry import TASKS


def view(
    workdir: Workdir = WORK,
    task: Annotated[str | None, tyro.conf.arg(help=f"which task to begin with: {', '.join(TASKS)}")] = None,
    kind: Annotated[
        str | None, tyro.conf.arg(help="what to begin with: objects, references, retarget, demos or evaluate")
    ] = None,
    find: Annotated[str, tyro.conf.arg(help="begin with an item whose name has these words")] = "",
    failed: Annotated[bool, tyro.conf.arg(help="begin with episodes that failed, of --policy if any")] = False,
    policy: Annotated[
        tuple[str, ...],
        tyro.conf.arg(help="further checkpoints, Python files with make_policy() or ONNX files, that can act"),
    ] = (),
    port: Annotated[int, Within(1, 65535), tyro.conf.arg(help="where on this machine; the next free one")] = 8080,
) -> None:
    """Look at objects, clips and episodes in the browser, and at trackers and policies while they act.

    The page is served to this machine alone. Over SSH: `ssh -L 8080:localhost:8080 <host>`.
    """
    from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName
    from mimicbench.viewer.server import check_installed

    if task is not None:
        TASKS.get(task)
    for path in policy:
        if not Path(path).exists():
            raise BadFile(f"{path} does not exist; give the folder of a checkpoint, a Python or an ONNX file")
    check_installed()
    from mimicbench.viewer.catalog import KINDS
    from mimicbench.viewer.page import Page, ViewConfig

    if kind is not None and kind not in KINDS:
        raise UnknownName("kind of items", kind, list(KINDS))
    if failed and kind not in (None, "evaluate"):
        raise MimicbenchError(f"only episodes can have failed: leave out --failed, or --kind {kind}")
    page = Page(ViewConfig(workdir, port, task, "evaluate" if failed else kind, find, failed, policy))
    print(f"page: {page.url} (Ctrl-C ends it)", flush=True)
    try:
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        print("closed", file=sys.stderr)
    finally:
        page.close()
