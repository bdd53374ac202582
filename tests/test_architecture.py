"""The packages: who may import whom, which libraries load late, no import circles."""

import ast
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from tests.samples.places import ROOT

PACKAGE = ROOT / "sonarmap"
ROOMS = ("kernels", "spectral", "slam", "tools")  # imports point left only
WINGS = ("files", "methods", "products", "lab", "command")  # of tools, likewise
FILES = sorted(path for room in ROOMS for path in (PACKAGE / room).rglob("*.py"))
# slow to load: inside the function that uses them
LATE = {"open3d", "matplotlib", "pyproj", "pyogrio", "laspy", "lazrs", "rosbags", "mcap"}
LATE |= {"lz4", "zstandard", "ruamel", "rasterio"}
# a library, and the one room that may import it
OWNERS = dict.fromkeys(LATE | {"plyfile", "wlsonar", "typer", "rich"}, "tools")
OWNERS |= {"pyopencl": "kernels", "gtsam": "slam"}
SLOW_TO_LOAD = {"pyopencl", "scipy", "gtsam", *LATE}


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0]


def modules_of(node: ast.AST) -> set[str]:
    """The modules that statements under a node import, in full."""
    modules: set[str] = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Import):
            modules.update(alias.name for alias in part.names)
        elif isinstance(part, ast.ImportFrom):
            assert part.level == 0, f"line {part.lineno}: a relative import hides its room"
            modules |= {part.module or "", *(f"{part.module}.{alias.name}" for alias in part.names)}
    return modules


def libraries(modules: set[str]) -> set[str]:
    return {module.split(".")[0] for module in modules}


def imported_at_load(tree: ast.Module) -> set[str]:
    """The modules that loading this one imports: its statements outside functions and `if TYPE_CHECKING`."""
    found: set[str] = set()
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found |= modules_of(node)
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            waiting += ast.iter_child_nodes(node)
    return found


def circle_in(graph: Mapping[str, set[str]]) -> str:
    """What imports itself over others; "" where nothing does."""
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return " -> ".join(error.args[1])
    return ""


@cache
def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(), str(path))


@cache
def imported_by(path: Path) -> set[str]:
    return modules_of(parse(path))


def named(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def test_imports_point_left() -> None:
    faults = []
    for path in FILES:
        room, modules = room_of(path), imported_by(path)
        to_the_right = ROOMS[ROOMS.index(room) + 1 :]
        for package in {module.split(".")[1] for module in modules if module.startswith("sonarmap.")} & set(
            to_the_right
        ):
            faults.append(f"{named(path)} imports {package}/, which lies to the right of {room}/")
        for package in libraries(modules):
            if package in ROOMS:
                faults.append(f"{named(path)} imports {package}, which is sonarmap.{package}")
            if OWNERS.get(package, room) != room:
                faults.append(f"{named(path)} imports {package}, which belongs to {OWNERS[package]}/ alone")
    assert not faults
    assert {room_of(path) for path in FILES} == set(ROOMS)
    links = {room: (ROOT / room).readlink().as_posix() for room in ROOMS}  # so that the top level shows them, too
    assert links == {room: f"sonarmap/{room}" for room in ROOMS}


def test_slow_libraries_load_late() -> None:
    """Inside the function that uses them."""
    early = {named(path): libraries(imported_at_load(parse(path))) & LATE for path in FILES}
    assert not {name: found for name, found in early.items() if found}


def test_the_command_line_starts_without_the_slow_libraries() -> None:
    program = f"import sys, sonarmap.tools.command.main; print(*({SLOW_TO_LOAD!r} & set(sys.modules)))"
    loaded = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert (loaded.stdout.split(), loaded.stderr) == ([], "")


FOLDERS = sorted({path.parent for path in FILES})
MODULES = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in FILES}


@cache
def imports() -> dict[str, set[str]]:
    """What each module imports of our own."""
    return {name: imported_by(path) & set(MODULES) for name, path in MODULES.items()}


def test_no_import_circle() -> None:
    """Neither at load nor inside functions: what two files need of each other belongs into a third."""
    assert not circle_in(imports())


def test_no_import_circle_between_folders() -> None:
    """The folders in a folder are built on one another one way, as files are, and the wings of tools in their order."""
    for folder in (PACKAGE, *FOLDERS):
        assert not circle_in(folders_in(folder)), named(folder)
    graph = folders_in(PACKAGE / "tools")
    assert set(graph) == set(WINGS)
    for wing in WINGS:
        assert graph[wing] <= set(WINGS[: WINGS.index(wing)]), wing


def folders_in(folder: Path) -> dict[str, set[str]]:
    """What each folder in this one imports of the others in it."""
    inside = len(folder.relative_to(ROOT).parts)
    begins = ".".join(folder.relative_to(ROOT).parts) + "."
    graph: dict[str, set[str]] = {}
    for name, imported in imports().items():
        if name.startswith(begins) and name.count(".") > inside:
            own = name.split(".")[inside]
            others = {
                other.split(".")[inside] for other in imported if other.startswith(begins) and other.count(".") > inside
            }
            graph.setdefault(own, set()).update(others - {own})
    return graph
