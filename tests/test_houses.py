"""How large files, functions and folders may be, and that no modules import each other in a circle."""

import ast
import re
from functools import cache
from pathlib import Path
from statistics import median

import pytest

SOURCE = Path(__file__).parents[1] / "src" / "mimicbench"
MODULES = sorted(SOURCE.rglob("*.py"))
MAX_LINES, MAX_FUNCTION_LINES, MAX_PARAMETERS, MAX_FILES = 300, 60, 8, 20


@cache
def parsed(path):
    return ast.parse(path.read_text())


def name_of(path):
    return path.relative_to(SOURCE).as_posix()


def functions():
    """(file:function, node) of every function and method."""
    for path in MODULES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield f"{name_of(path)}:{node.name}", node


def lines(function):
    return function.end_lineno - function.lineno + 1


def parameters(function):
    """How many there are; `self` and `cls` are none."""
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    return len([one for one in named if one.arg not in ("self", "cls")])


def module_of(path):
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {module_of(path): path for path in MODULES}


def on_import(body):
    """The statements that run when a module is imported: none of functions, none for type checkers alone."""
    for node in body:
        yield node
        if isinstance(node, ast.ClassDef | ast.With | ast.For):
            yield from on_import(node.body)
        elif isinstance(node, ast.Try):
            yield from on_import([*node.body, *node.orelse, *node.finalbody])
            yield from on_import([inner for handler in node.handlers for inner in handler.body])
        elif isinstance(node, ast.If):
            yield from on_import(node.orelse if "TYPE_CHECKING" in ast.unparse(node.test) else node.body + node.orelse)


def imported(body):
    """Modules of ours that statements import."""
    for node in on_import(body):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in NAMES)
        elif isinstance(node, ast.ImportFrom):
            whole = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name if name in NAMES else str(node.module) for name in whole if {name, node.module} & {*NAMES})


def circle(graph):
    """Modules that import each other in a circle, in order, or None."""
    done = set()

    def visit(name, way):
        if name in way:
            return [*way[way.index(name) :], name]
        if name in done:
            return None
        found = next(filter(None, (visit(other, [*way, name]) for other in graph[name])), None)
        done.add(name)
        return found

    return next(filter(None, (visit(name, []) for name in graph)), None)


def test_files_are_short():
    long = {name_of(path) for path in MODULES if len(path.read_text().splitlines()) > MAX_LINES}
    assert not long, f"files of more than {MAX_LINES} lines"


def test_most_files_are_shorter():
    """The median of what is not the first line of a package; 120 is aimed at."""
    sizes = [len(path.read_text().splitlines()) for path in MODULES if path.name != "__init__.py"]
    assert median(sizes) < 130


def test_functions_are_short():
    long = {name for name, node in functions() if lines(node) > MAX_FUNCTION_LINES}
    assert not long, f"functions of more than {MAX_FUNCTION_LINES} lines"


def test_functions_take_few_parameters():
    many = {name for name, node in functions() if parameters(node) > MAX_PARAMETERS}
    assert not many, f"functions of more than {MAX_PARAMETERS} parameters: make one dataclass of some"


def test_folders_hold_few_files():
    folders = {path.parent for path in MODULES}
    assert not [name_of(folder) for folder in folders if len(list(folder.glob("*.py"))) > MAX_FILES]


def test_learning_names_no_task_and_no_object():
    words = re.compile(r"\b(seat|chair|stool|sofa|couch|bed|berth|box|furniture)(es|s)?\b", re.IGNORECASE)
    for folder in ("imitate", "policies", "track"):
        for path in (SOURCE / folder).rglob("*.py"):
            told = path.read_text().replace("sit-chair", "")  # the example of a name
            assert not words.search(told), f"{name_of(path)} speaks of a {words.search(told)}"


def test_no_modules_import_each_other():
    graph = {name: sorted({*imported(parsed(path).body)} - {name}) for name, path in NAMES.items()}
    assert graph["mimicbench.core.motion"], "imports are found at all"
    assert circle(graph) is None


@pytest.mark.parametrize(
    ("graph", "found"),
    [
        ({"a": ["b"], "b": ["c"], "c": []}, None),
        ({"a": ["b", "c"], "b": ["c"], "c": []}, None),
        ({"a": ["b"], "b": ["c"], "c": ["b"]}, ["b", "c", "b"]),
    ],
)
def test_circles_are_found(graph, found):
    assert circle(graph) == found


def test_what_runs_on_import():
    source = """
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    from mimicbench.core import motion
else:
    from mimicbench.core import files
try:
    import mimicbench.core.seeds
except ImportError:
    from mimicbench.core.names import nothing
def function():
    from mimicbench.core import rotations
"""
    found = set(imported(ast.parse(source).body))
    assert found == {"mimicbench.core.files", "mimicbench.core.seeds", "mimicbench.core.names"}


def test_sizes_are_counted():
    method, free = ast.walk(ast.parse("class A:\n    def f(self, a, *b, c=1, **d):\n        pass")), "def f(a, /):\n  1"
    assert [parameters(node) for node in method if isinstance(node, ast.FunctionDef)] == [4]
    function = ast.parse(free).body[0]
    assert (parameters(function), lines(function)) == (1, 2)
