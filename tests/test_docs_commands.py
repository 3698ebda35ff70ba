"""Commands in the documents: each is there, and takes the settings that the page gives to it. None is run."""

import importlib
import re
import shlex
from functools import wraps
from pathlib import Path

import pytest
import tyro

from mimicbench.cli import COMMANDS
from mimicbench.commands.compare import CompareOptions
from mimicbench.commands.judge import RunOptions
from mimicbench.commands.parsing import Options, read_call, read_compared
from mimicbench.comparisons.registry import COMPARISONS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(?:sh)?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINE = re.compile(r"^(?:\.venv/bin/)?mimicbench (.+)$", re.MULTILINE)
INLINE = re.compile(r"`mimicbench ([^`]+)`")
OTHERS = {"stand-by", "still", "standing", "follow", "focus"}
"""Names of packages that are not installed here (tests/packages)."""
STAGE = {"demos verify": "demos", "run": "evaluate"}
"""Commands that read a recipe -> up to which stage, if it is not called the same."""


def calls(text):
    """Arguments of every `mimicbench` of a page; what stands for something else (<task>, ..., COMMAND) is left out."""
    lines = [line for block in BLOCK.findall(text) for line in LINE.findall(block.replace("\\\n", " "))]
    for line in [*lines, *INLINE.findall(BLOCK.sub("", text))]:
        words = shlex.split(line.split(" && ")[0], comments=True)
        told = any(re.search(r"[<>…]|\.\.\.|^[A-Z]+$", word) for word in words)
        if not told and not OTHERS & set(words) and words[0] not in ("--help", "--version", "--completion"):
            yield words


def take(words):
    """Let the command read its arguments, and no more. Raises MimicbenchError, or SystemExit unless it is for help."""
    name = " ".join(words[:2]) if " ".join(words[:2]) in COMMANDS else words[0]
    assert name in COMMANDS, f"there is no command {name!r}"
    command, rest = COMMANDS[name], words[len(name.split()) :]
    if rest in ([], ["--help"]):
        return
    if name == "compare":
        read_compared(COMPARISONS.get(rest[0]), rest[1:], CompareOptions)
        return
    if command.recipe:
        stage = STAGE.get(name, name)
        read_call(stage, rest, RunOptions if name == "run" else Options, command=name)
        return
    function = getattr(importlib.import_module(f"mimicbench.commands.{command.module}"), command.function)
    tyro.cli(wraps(function)(lambda *values, **named: None), args=rest)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_of_a_page_can_be_read(page, tmp_path, monkeypatch, capsys):
    text = page.read_text(encoding="utf8")
    monkeypatch.chdir(tmp_path)
    for name, toml in re.findall(r"^```toml\n# (\w+\.toml)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        Path(name).write_text(toml)
    wrong = []
    for words in calls(text):
        try:
            take(words)
        except (Exception, SystemExit) as error:  # noqa: BLE001 all of a page are told at once
            wrong.append(f"mimicbench {shlex.join(words)}: {error!r} {capsys.readouterr().err.strip()[-300:]}")
    assert not wrong, "\n".join(wrong)


def test_wrong_commands_are_found(capsys):
    block = "mimicbench report\nmimicbench view --colour red  # so\nmimicbench <command>\n"
    page = f"```sh\n{block}```\n`mimicbench track --x 1`"
    found = list(calls(page))
    assert found == [["report"], ["view", "--colour", "red"], ["track", "--x", "1"]]
    for words in found:
        with pytest.raises((AssertionError, SystemExit)):
            take(words)
