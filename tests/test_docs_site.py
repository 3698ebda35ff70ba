"""The site of the documents: it is built without a warning, and has a page for whatever is registered."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mimicbench.imitate.registry import LEARNERS
from mimicbench.references.importers.registry import FORMATS
from mimicbench.retarget.registry import METHODS
from mimicbench.sensors.observations import TERMS
from mimicbench.sensors.term import WORDS
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def made():
    """The generated pages, which need no MkDocs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "scripts"))
        import docs_pages

        yield docs_pages.pages()


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs", reason="MkDocs is not installed: pip install 'mimicbench[docs]'")
    pytest.importorskip("mkdocstrings", reason="mkdocstrings is not installed: pip install 'mimicbench[docs]'")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    built = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    return out


def test_every_observation_has_words():
    assert set(WORDS) == set(TERMS)


def test_pages_say_what_the_code_says(made):
    for task in TASKS.all():
        page = made[f"tasks/{task.name}.md"]
        assert f"| time limit | {task.time_limit:g} s |" in page
        told = re.findall(r"^\| `([\w+]+)` \|", page, re.MULTILINE)
        assert told == [term.name for term in TERMS.values() if term.exists(task)]
    assert "| `proprio` | (48) | any policy |" in made["tasks/sit-chair.md"]
    assert "| `depth` | (4, height, width) | any policy |" in made["tasks/sit-chair.md"]
    assert "| `object` | (12) | privileged |" in made["tasks/lift-box.md"]
    assert "`targets`" in made["tasks/touch-points.md"] and "`targets`" not in made["tasks/lie-bed.md"]


def test_there_is_a_page_of_every_method_sensor_and_kind_of_file(made):
    for folder, registry in (
        ("trackers", TRACKERS),
        ("learners", LEARNERS),
        ("retargeting", METHODS),
        ("recordings", FORMATS),
    ):
        for name in registry:
            page = made[f"methods/{folder}/{name}.md"]
            assert name in page.splitlines()[0] and len(page.splitlines()[2]) > 20 and "::: mimicbench." in page
    assert "`--track.settings.ankles` | `0.2`" in made["methods/trackers/residual.md"]
    sensed = [made[name] for name in made if name.startswith("methods/sensors/")]
    for term in TERMS.values():
        assert sum(f"| `{term.name}` |" in page for page in sensed) == (not term.privileged), term.name
    assert {"stages", "objects", "motions", "demonstrations", "checkpoints", "episodes"} <= {
        Path(name).stem for name in made if name.startswith("methods/files/")
    }


def test_links_of_pages_in_folders_stay_links(site):
    page = (site / "tasks" / "sit-chair.html").read_text(encoding="utf8")
    assert 'href="../definitions.html"' in page and 'href="../methods/observations.html"' in page
    assert (
        'href="../../formats.html#demonstrations"' in (site / "methods" / "files" / "demonstrations.html").read_text()
    )
    assert "tests/packages" in (site / "extending.html").read_text(encoding="utf8")


def test_settings_have_their_defaults_bounds_and_words(made):
    assert "| `--references.count` |" in made["settings/references.md"]
    assert "| `--track.ppo.gamma` | `0.97` |" in made["settings/track.md"]
    own = made["settings/track.md"].split("## With `--track.tracker residual`")[1].split("\n## ")[0]
    assert "| `--track.settings.ankles` | `0.2` |  | Of exp(-5 d)" in own and "--track.samples" not in own
    assert re.search(r"`--track\.until` \| `1.0` \| 0 to 1 \| Share of robots", made["settings/track.md"])
    for name, page in made.items():
        if name.startswith(("settings/", "methods/")):
            assert "lambda" not in page and "object at 0x" not in page, name


@pytest.mark.parametrize("task", TASKS)
def test_the_site_has_a_page_of_every_task(site, task):
    page = (site / "tasks" / f"{task}.html").read_text(encoding="utf8")
    assert f"mimicbench/{''.join(word.capitalize() for word in task.split('-'))}-v0" in page


def test_the_site_needs_nothing_from_elsewhere(site):
    for page in site.rglob("*.html"):
        fetched = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="(https?:[^"]+)"', page.read_text(encoding="utf8"))
        assert not [address for address in fetched if "canonical" not in address], page
    api = (site / "api" / "runs.html").read_text(encoding="utf8")
    assert "run_stage" in api and "Recipe" in api
