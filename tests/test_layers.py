"""The rooms of the house: who may import whom, what loads late, and how long a file may grow."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("kernels", "spectral", "slam", "tools")  # imports point left only
FILES = sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py"))
OWNERS = {  # a library, and the one room that may import it
    "pyopencl": "kernels",
    "gtsam": "slam",
    "open3d": "tools",
    "matplotlib": "tools",
    "pyproj": "tools",
    "plyfile": "tools",
    "wlsonar": "tools",
    "typer": "tools",
    "rich": "tools",
}
LATE = {"open3d", "matplotlib", "pyproj"}  # slow to load: inside the function that uses them
SLOW_TO_LOAD = {"pyopencl", "scipy", "open3d", "gtsam", "matplotlib", "pyproj"}
MOST_LINES = 400


def room_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0]


def imported(tree: ast.AST) -> Iterator[str]:
    """The top-level packages that any statement under a node imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import hides its room"
            yield (node.module or "").split(".")[0]


def imported_at_load(tree: ast.Module) -> set[str]:
    """What loading the module imports: its statements outside functions and `if TYPE_CHECKING`."""
    found: set[str] = set()
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.update(imported(node))
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            waiting += ast.iter_child_nodes(node)
    return found


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(), str(path))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_left(path: Path) -> None:
    room = room_of(path)
    to_the_right = ROOMS[ROOMS.index(room) + 1 :]
    for package in imported(parse(path)):
        assert package not in to_the_right, f"{room}/ must not import {package}/"
        assert OWNERS.get(package, room) == room, f"{package} is imported in {OWNERS[package]}/ only"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_slow_libraries_load_late(path: Path) -> None:
    early = imported_at_load(parse(path)) & LATE
    assert not early, f"import {', '.join(early)} inside the function that uses it"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_stay_short(path: Path) -> None:
    lines = len(path.read_text().splitlines())
    assert lines <= MOST_LINES, f"{lines} lines: divide it by meaning"


def test_the_command_line_starts_without_the_slow_libraries() -> None:
    program = f"import sys, tools.cli.main; print(*({SLOW_TO_LOAD!r} & set(sys.modules)))"
    loaded = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert (loaded.stdout.split(), loaded.stderr) == ([], "")


def test_the_rooms_are_there() -> None:
    assert {room_of(path) for path in FILES} == set(ROOMS)
