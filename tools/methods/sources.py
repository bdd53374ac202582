"""Digests of the code that decides a result: what a piece of it imports, and what that imports."""

import ast
import hashlib
import re
from collections.abc import Collection, Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
TABLE = Path("tools/methods/registry.py")  # it imports every method's modules, each in a function of its own

# The last words in the names of those modules of tools/reproduce that only show rows.
SHOWING = ("figure", "page", "summary", "tables", "section", "table", "text", "wilson", "experiments")

_DOTTED = re.compile(r"(\w+\.)+\w+(:\w+)?")  # a module's name, and what is taken from it


def method_digest(make: str, on_device: bool, modules: Iterable[Path] = (), root: Path = ROOT) -> str:
    """A digest of all code that decides what a method finds.

    Args:
        make: the function of the table that builds the method: it counts, with the functions that it calls, what
            these import, and what that imports.
        on_device: whether the OpenCL programs count.
        modules: further Python files; what they import counts, but for the table of methods.
        root: of the project.
    """
    table = root / TABLE
    called = _called(ast.parse(table.read_bytes()), make)
    also = [file for function in called for file in imports(function, root)]
    files = imported([*(module.resolve() for module in modules), *also], root, [table])
    return digest_of({*files, *(programs(root) if on_device else ())}, root, "\n".join(map(decisive, called)))


def programs(root: Path = ROOT) -> list[Path]:
    """Every OpenCL program."""
    return list((root / "kernels").rglob("*.cl"))


def digest_of(paths: Iterable[Path], root: Path = ROOT, further: str = "") -> str:
    """A digest of files' names and contents, and of a further text: 16 hexadecimal digits."""
    digest = hashlib.sha256(further.encode())
    for path in sorted(paths):
        content = _content(path)
        name = path.relative_to(root).as_posix() if path.is_relative_to(root) else path.name
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()[:16]


def imported(modules: Iterable[Path], root: Path = ROOT, left_out: Collection[Path] = ()) -> set[Path]:
    """Modules and all modules of the project that they import.

    Args:
        modules: Python files.
        root: of the project.
        left_out: not to be looked at, as are those that only show rows.
    """
    found, waiting = set(), list(modules)
    while waiting:
        path = waiting.pop()
        if path in found or path in left_out or _only_shows(path, root):
            continue
        found.add(path)
        waiting += imports(ast.parse(path.read_bytes()), root)
    return found


def imports(tree: ast.AST, root: Path = ROOT) -> list[Path]:
    """The project's files that a piece of Python imports, anywhere in it."""
    return [file for node in ast.walk(tree) for name in _names(node) for file in _of_module(name, root)]


def decisive(tree: ast.AST) -> str:
    """What of a piece of Python decides: all but comments, layout and docstrings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, False) is not None:
            node.body[0] = ast.Pass()
    return ast.dump(tree)


def _called(table: ast.Module, make: str) -> list[ast.AST]:
    """The function of this name and those of the table that it calls; the whole table where it is none of them."""
    functions = {node.name: node for node in table.body if isinstance(node, ast.FunctionDef)}
    if make not in functions:
        return [table]
    found, waiting = [], [make]
    while waiting:
        name = waiting.pop()
        if functions[name] in found:
            continue
        found.append(functions[name])
        names = {node.id for node in ast.walk(functions[name]) if isinstance(node, ast.Name)}
        waiting += sorted(names & functions.keys())
    return found


def _content(path: Path) -> bytes:
    content = path.read_bytes()
    return decisive(ast.parse(content)).encode() if path.suffix == ".py" else content


def _only_shows(path: Path, root: Path) -> bool:
    return path.is_relative_to(root / "tools/reproduce") and path.stem.split("_")[-1] in SHOWING


def _names(node: ast.AST) -> list[str]:
    """The modules that a node may mean: `from a import b` has a, and a.b may be one too. Tables name some as text."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module:
        return [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and _DOTTED.fullmatch(node.value):
        return [node.value.partition(":")[0]]
    return []


def _of_module(name: str, root: Path) -> list[Path]:
    path = root.joinpath(*name.split("."))
    return [file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file()]
