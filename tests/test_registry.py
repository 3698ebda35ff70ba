"""Registries know their names without imports, and items of other people's packages like their own."""

import subprocess
import sys

import pytest

from mimicbench.comparisons.registry import COMPARISONS
from mimicbench.core import registry
from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.objects.registry import FAMILIES
from mimicbench.references.importers.registry import FORMATS
from mimicbench.references.synthesis.registry import SYNTHESES
from mimicbench.report.tables.registry import HEADLINES, TABLES
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS

REGISTRIES = (TASKS, ROBOTS, FAMILIES, SYNTHESES, FORMATS, METHODS, TABLES, COMPARISONS)
STOOLS = """
from mimicbench.objects.family import Family
from mimicbench.objects.families.chair import make_chair
STOOLS = Family("stool", lambda index, seed: make_chair(index, seed))
CHAIRS = Family("chair", STOOLS.make)
NUMBER = 3
"""


@pytest.mark.parametrize("of", REGISTRIES, ids=lambda of: of.what)
def test_every_item_is_what_its_registry_says(of):
    assert [item.name for item in of.all()] == list(of) == list(of.names())
    assert len(of) == len(set(of)) > 0 and all(name in of for name in of)
    assert set(of.first) <= set(of), "what is listed first must be there"
    with pytest.raises(UnknownName, match=f"unknown {of.what} 'nothing'; known are: .*{of.names()[0]}"):
        of.get("nothing")


def test_the_papers_order():
    assert TASKS.names() == ("sit-chair", "sit-sofa", "lie-bed", "lie-sofa", "touch-points", "lift-box")
    assert METHODS.names() == ("copy-rotation", "omnih2o", "optimization", "interaction")
    assert set(HEADLINES) <= set(TABLES)


def test_names_import_nothing():
    modules = ("tasks", "robots", "objects", "references.importers", "retarget", "report.tables", "comparisons")
    script = "import sys\n" + "".join(
        f"import mimicbench.{module}.registry as r{i}\n" for i, module in enumerate(modules)
    )
    script += "print(r0.TASKS.names(), r1.ROBOTS.names(), r2.FAMILIES.names(), r3.FORMATS.names())\n"
    script += "print(r4.METHODS.names(), r5.TABLES.names(), r6.COMPARISONS.names())\n"
    script += "assert not {'numpy', 'torch', 'mujoco', 'scipy', 'pyarrow'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "sit-chair" in done.stdout and "intermimic" in done.stdout


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Installs a package `stools` whose metadata registers the given entry points of families."""

    def install(entries, name="stools"):
        (tmp_path / f"{name}.py").write_text(STOOLS)
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[mimicbench.families]\n" + "\n".join(entries) + "\n")
        monkeypatch.syspath_prepend(str(tmp_path))
        registry._foreign.cache_clear()

    yield install
    for name in ("stools", "seats"):
        sys.modules.pop(name, None)
    monkeypatch.undo()
    registry._foreign.cache_clear()


def test_a_package_of_somebody_else_adds_an_item(install):
    own = FAMILIES.names()
    install(["stool = stools:STOOLS"])
    assert FAMILIES.names() == (*own, "stool") and "stools" not in sys.modules
    assert FAMILIES.get("stool").make(3, 0).id == "chair-0-00003"
    assert FAMILIES.get("chair").name == "chair"


def test_what_is_wrong_with_somebody_elses_package_is_said(install):
    install(
        [
            "number = stools:NUMBER",
            "stol = stools:STOOLS",
            "gone = stools:GONE",
            "chair = stools:CHAIRS",
            "twice = stools:STOOLS",
        ]
    )
    install(["twice = seats:STOOLS"], "seats")
    with pytest.raises(MimicbenchError, match="family of objects 'number' is int, not a .*family.Family"):
        FAMILIES.get("number")
    with pytest.raises(MimicbenchError, match="'stol' calls itself 'stool'; give it one name"):
        FAMILIES.get("stol")
    with pytest.raises(MimicbenchError, match="'gone' of the package stools cannot be imported .*GONE"):
        FAMILIES.get("gone")
    with pytest.raises(MimicbenchError, match=r"'chair' is registered more than once \(stools\)"):
        FAMILIES.get("chair")
    with pytest.raises(MimicbenchError, match="'twice' is registered more than once.*(seats, stools|stools, seats)"):
        FAMILIES.get("twice")
