"""Where numbers come from: seed, commands, configuration, versions, hardware. Names no user, host or folder."""

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = ("mimicbench", "mujoco", "torch", "rsl-rl-lib", "numpy", "scipy", "pyarrow")


def without_folders(word: str) -> str:
    """A word of a command line; of an absolute path, also behind `--name=`, the last part."""
    name, sign, value = word.partition("=") if word.startswith("-") else ("", "", word)
    return f"{name}{sign}{Path(value).name or value}" if value.startswith(("/", "~")) else word


@dataclass(frozen=True)
class Provenance:
    """What it takes to make the numbers again."""

    seed: int
    commands: tuple[str, ...] = ()
    """As typed, in order."""
    config: Mapping[str, Any] = field(default_factory=dict)
    """Resolved configuration as plain JSON values."""
    made_from: Mapping[str, str] = field(default_factory=dict)
    """Stage -> fingerprint of its folder."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Package -> version; `package_versions()`."""
    hardware: Mapping[str, str] = field(default_factory=dict)
    """`this_machine()`, or that of the training."""


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def this_machine() -> dict[str, str]:
    """Processor, memory and system of this machine, as far as it tells."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    found = {"processor": _cpu_name(), "cores": str(cores), "system": f"{platform.system()} {platform.machine()}"}
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        found["memory"] = f"{os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.0f} GiB"
    return found


def _cpu_name() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown"
