"""`mimicbench doctor`: whether this machine can do everything."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

from mimicbench.commands.options import WORK, Json, Workdir


def doctor(workdir: Workdir = WORK, as_json: Json = False) -> None:
    """Examine this machine: versions, threads, memory, disk, pictures, GPU, each with what to do.

    Ends with status 1 if something that is needed does not work.
    """
    from mimicbench.doctor import examine

    findings = examine(workdir)
    if as_json:
        print(json.dumps({"findings": [asdict(one) for one in findings]}))
    else:
        width = max(len(one.name) for one in findings)
        for one in findings:
            print(f"{one.state:<5}  {one.name:<{width}}  {one.found}")
            if one.advice:
                print(f"{'':<{width + 9}}{one.advice}")
    if any(one.state == "fault" for one in findings):
        sys.exit(1)
