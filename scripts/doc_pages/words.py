"""Markdown, and what docstrings say."""

import ast
import inspect
import sys
import textwrap
from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from mimicbench.core.registry import Registry

Rows = Iterable[Sequence[object]]


def table(head: Sequence[str], rows: Rows) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def summary(doc: str | None) -> str:
    """The first paragraph of a docstring, in one line."""
    return " ".join(inspect.cleandoc(doc or "").split("\n\n")[0].split())


def field_docs(kind: type) -> dict[str, str]:
    """Name of a field -> the docstring beneath it, those of base classes included."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        try:
            body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        except (OSError, TypeError):  # made while the program runs, or not in Python
            continue
        lines = body.body if isinstance(body, ast.ClassDef) else []
        for field, doc in zip(lines, lines[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(doc, ast.Expr):
                text = doc.value.value if isinstance(doc.value, ast.Constant) else None
                found |= {field.target.id: " ".join(text.split())} if isinstance(text, str) else {}
    return found


def described(registry: Registry[Any], name: str) -> str:
    """What the module of an item says of it."""
    return summary(getattr(sys.modules.get(defined_in(registry, name)), "__doc__", ""))


def defined_in(registry: Registry[Any], name: str) -> str:
    """The module that an item of a registry stands in."""
    own = f"{registry.package}.{name.replace('-', '_')}"
    return import_module(own).__name__ if find_spec(own) else type(registry.get(name)).__module__
