"""The packages: allowed imports, libraries that load late, no import cycles."""

import ast
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from tests.samples.places import ROOT

PACKAGE = ROOT / "sonarmap"
LAYERS = ("kernels", "spectral", "slam", "tools")  # imports point left only
SUBFOLDERS = ("files", "methods", "products", "lab", "command")  # of tools, likewise
FILES = sorted(path for layer in LAYERS for path in (PACKAGE / layer).rglob("*.py"))
# slow to load: inside the function that uses them
LATE = {"open3d", "matplotlib", "pyproj", "pyogrio", "laspy", "lazrs", "rosbags", "mcap"}
LATE |= {"lz4", "zstandard", "rasterio"}
# a library, and the one layer that may import it
OWNERS = dict.fromkeys(LATE | {"plyfile", "wlsonar", "typer", "rich"}, "tools")
OWNERS |= {"pyopencl": "kernels", "gtsam": "slam"}
SLOW_TO_LOAD = {"pyopencl", "scipy", "gtsam", *LATE}


def layer_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0]


def modules_of(node: ast.AST) -> set[str]:
    """The modules that statements under a node import, in full."""
    modules: set[str] = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Import):
            modules.update(alias.name for alias in part.names)
        elif isinstance(part, ast.ImportFrom):
            assert part.level == 0, f"line {part.lineno}: a relative import hides its layer"
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


def cycle_in(graph: Mapping[str, set[str]]) -> str:
    """An import cycle as "a -> b -> a"; "" without one."""
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


def test_imports_follow_the_order_of_the_layers() -> None:
    faults = []
    for path in FILES:
        layer, modules = layer_of(path), imported_by(path)
        to_the_right = LAYERS[LAYERS.index(layer) + 1 :]
        for package in {module.split(".")[1] for module in modules if module.startswith("sonarmap.")} & set(
            to_the_right
        ):
            faults.append(f"{named(path)} imports {package}/, which lies to the right of {layer}/")
        for package in libraries(modules):
            if package in LAYERS:
                faults.append(f"{named(path)} imports {package}, which is sonarmap.{package}")
            if OWNERS.get(package, layer) != layer:
                faults.append(f"{named(path)} imports {package}, which belongs to {OWNERS[package]}/ alone")
    assert not faults
    assert {layer_of(path) for path in FILES} == set(LAYERS)
    links = {layer: (ROOT / layer).readlink().as_posix() for layer in LAYERS}  # the top level shows them, too
    assert links == {layer: f"sonarmap/{layer}" for layer in LAYERS}


def test_slow_libraries_are_imported_inside_functions() -> None:
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
    """The modules of this package that each module imports."""
    return {name: imported_by(path) & set(MODULES) for name, path in MODULES.items()}


def test_no_import_cycle() -> None:
    """Neither at load nor inside functions: code that two files need of each other belongs in a third."""
    assert not cycle_in(imports())


def test_no_import_cycle_between_folders() -> None:
    """Subfolders of a folder import each other one way only, those of tools in the order of SUBFOLDERS."""
    for folder in (PACKAGE, *FOLDERS):
        assert not cycle_in(folders_in(folder)), named(folder)
    graph = folders_in(PACKAGE / "tools")
    assert set(graph) == set(SUBFOLDERS)
    for subfolder in SUBFOLDERS:
        assert graph[subfolder] <= set(SUBFOLDERS[: SUBFOLDERS.index(subfolder)]), subfolder


def folders_in(folder: Path) -> dict[str, set[str]]:
    """The sibling folders that each subfolder imports."""
    inside = len(folder.relative_to(ROOT).parts)
    begins = ".".join(folder.relative_to(ROOT).parts) + "."
    graph: dict[str, set[str]] = {}
    for name, imported in imports().items():
        if name.startswith(begins) and name.count(".") > inside:
            subfolder = name.split(".")[inside]
            others = {
                other.split(".")[inside] for other in imported if other.startswith(begins) and other.count(".") > inside
            }
            graph.setdefault(subfolder, set()).update(others - {subfolder})
    return graph
