"""Pages of the documents that nobody types: tasks, methods, observations, settings and the API, out of the code.

MkDocs calls it as a hook (mkdocs.yml). `python scripts/docs_pages.py --out FOLDER` writes the same pages as files.
"""

import argparse
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from doc_pages import each, methods, settings, tasks
from mimicbench.benchmark.recipe import PARTS
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.tasks.registry import TASKS

ROOT = Path(__file__).parents[1]
API = {
    "runs": ("benchmark", "benchmark.recipe", "benchmark.graph", "core.stage", "core.settings", "core.registry"),
    "environments": ("envs.gym", "envs.gym_vector", "envs.episodes", "envs.vec_env", "envs.policy"),
    "tasks-and-objects": (
        *("tasks.task", "tasks.body_points", "tasks.goal"),
        *("objects.shape", "objects.family", "objects.registry"),
    ),
    "robots": ("robots.description", "robots.mapping", "robots.rigs"),
    "motions": ("core.motion", "core.motion_file", "core.rotations", "retarget.method", "retarget.clip"),
    "senses": ("sensors.observations", "sensors.term", "sensors.context", "sensors.elevation", "sim.physics"),
    "learning": (
        "track.spec",
        "track.train",
        "track.learning.ppo",
        "track.learning.distillation",
        "imitate.spec",
        "imitate.cloning",
        "imitate.policy",
    ),
    "judging": ("policies.loading", "policies.loader", "evaluate.rollout", "evaluate.rows", "evaluate.intervals"),
    "tables": ("report.table", "report.tables.spec"),
    "errors-and-seeds": ("core.errors", "core.seeds"),
}
"""Modules whose interface others build on, page by page."""


@cache
def pages() -> Mapping[str, str]:
    """Every generated page: its path among the documents -> its Markdown."""
    robot = ROBOTS.get(DEFAULT_ROBOT)
    return {
        "tasks/index.md": tasks.tasks_page(),
        **{f"tasks/{task.name}.md": tasks.task_page(task, robot) for task in TASKS.all()},
        "methods/retargeting.md": methods.retargeting_page(),
        "methods/trackers.md": methods.trackers_page(robot),
        "methods/learners.md": methods.learners_page(),
        "methods/tables.md": methods.tables_page(),
        "methods/observations.md": tasks.observations_page(robot),
        **dict(each.each_pages()),
        "settings/presets.md": settings.presets_page(),
        **{f"settings/{part}.md": settings.settings_page(part) for part in PARTS},
        **{f"api/{name}.md": api_page(name, modules) for name, modules in API.items()},
        **moved_pages(),
    }


def api_page(name: str, modules: Sequence[str]) -> str:
    """A page of the API; mkdocstrings fills it in."""
    every = "\n\n".join(f"::: mimicbench.{module}" for module in modules)
    return f"# {name.replace('-', ' ').capitalize()}\n\n{every}\n"


def moved_pages() -> dict[str, str]:
    """What stands beside the folder of documents, with links as seen from inside."""
    changes, contributing = ((ROOT / f"{name}.md").read_text(encoding="utf8") for name in ("CHANGELOG", "CONTRIBUTING"))
    found = {"changelog.md": changes, "contributing.md": contributing}
    return {path: linked(re.sub(r"\]\((?!docs/|\w+:|#)", "](../", text)) for path, text in found.items()}


def linked(text: str, depth: int = 0) -> str:
    """Links into docs/ as seen from a page so many folders below it; what lies outside has no page, and is named."""
    outside = r"\.\./" * (depth + 1)
    text = text.replace("](docs/", "](")
    return re.sub(
        rf"(?<!!)\[([^\]]+)\]\({outside}([^)]+)\)", lambda m: f"{m[1]} (`{m[2]}`)" if m[1] != m[2] else m[1], text
    )


def on_config(config: Any) -> Any:
    """MkDocs: entries of the navigation that end in a slash stand for all generated pages of that folder."""
    config.nav = [
        {title: listed(entry) if isinstance(entry, str) and entry[-1] == "/" else entry}
        for group in config.nav
        for title, entry in group.items()
    ]
    return config


def listed(folder: str) -> list[Any]:
    """The generated pages of a folder, and those of its folders below a title each."""
    found: list[Any] = [page for page in pages() if page.startswith(folder) and "/" not in page[len(folder) :]]
    for below, title in each.titles().items():
        if below.startswith(folder):
            found.append({title: [page for page in pages() if page.startswith(f"{below}/")]})
    return found


def on_files(files: Any, config: Any) -> Any:
    """MkDocs: adds the generated pages."""
    made = import_module("mkdocs.structure.files").File.generated  # an extra, which who checks types need not have
    for path, text in pages().items():
        files.append(made(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Mapping[str, Any]) -> str:
    """MkDocs: what lies outside of docs/ has no page."""
    return linked(markdown, page.file.src_uri.count("/"))


def on_post_page(output: str, **_: Any) -> str:
    """MkDocs: the theme's search asks for a script of another host where pages are opened as files; none is fetched."""
    return re.sub(r'<script src="https?://[^"]+"></script>', "", output)


def on_post_template(output_content: str, **_: Any) -> str:
    """MkDocs: the same for pages without a source, such as that for what is not found."""
    return on_post_page(output_content)


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(description="Write the generated pages of the documents.")
    parser.add_argument("--out", type=Path, required=True, help="folder for them")
    out = parser.parse_args().out
    for path, text in pages().items():
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        (out / path).write_text(text, encoding="utf8")
    print(f"pages: {out}")


if __name__ == "__main__":
    main()
