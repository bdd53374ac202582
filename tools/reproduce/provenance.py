"""Where an experiment's rows come from: its settings, the code, the device, and what is installed."""

import ast
import hashlib
import inspect
import json
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kernels.device import Device
from tools.bench.machine import describe_machine
from tools.reproduce.experiment import Experiment
from tools.writers.summary import package_versions, to_json

ROOT = Path(__file__).parents[2]

# The last words in the names of those modules of tools/reproduce that only show rows.
SHOWING = ("figure", "page", "summary", "tables", "section", "table", "text", "wilson", "experiments")


_DOTTED = re.compile(r"(\w+\.)+\w+(:\w+)?")  # a module's name, and what is taken from it


@dataclass(frozen=True, slots=True)
class Provenance:
    """What has to be the same for rows to be the same, and the machine for people.

    Attributes:
        name: the experiment's.
        settings: its settings in JSON's types.
        sources: digest of the code that decides rows.
        device, platform: the OpenCL device and its driver.
        versions: of Python, the system and the packages.
        processor, cores: the host's; they decide nothing.
    """

    name: str
    settings: Mapping[str, Any]
    sources: str
    device: str
    platform: str
    versions: Mapping[str, str | None]
    processor: str
    cores: int

    @property
    def fingerprint(self) -> str:
        """A digest of all that decides rows, 16 hexadecimal digits."""
        deciding = [self.name, self.settings, self.sources, self.device, self.platform, self.versions]
        return hashlib.sha256(json.dumps(to_json(deciding), sort_keys=True).encode()).hexdigest()[:16]

    @property
    def place(self) -> str:
        """The machine in a few words: of the driver's long text what stands before its features."""
        host = f"{self.processor}, {self.cores} cores" if self.processor else f"{self.cores} cores"
        driver = self.platform.split("  ")[0].split(",")[0]
        return f"{self.device} ({driver}; {host})"


def provenance(experiment: Experiment, device: Device) -> Provenance:
    """Of an experiment on a device, with the code as it is on disk now."""
    machine = describe_machine(device)
    return Provenance(
        name=experiment.name,
        settings=to_json(experiment.settings),
        sources=source_digest(source_of(experiment)),
        device=device.name,
        platform=device.platform,
        versions=package_versions(),
        processor=machine.processor,
        cores=machine.cores,
    )


def source_digest(module: Path, root: Path = ROOT) -> str:
    """A digest of the names and contents of all files that decide the rows of the experiment in `module`.

    Args:
        module: a Python file; what it imports counts, and what that imports, and every OpenCL program.
        root: of the project.
    """
    return digest_of({*programs(root), *imported([module.resolve()], root)}, root)


def source_of(experiment: Experiment) -> Path:
    """The file with the experiment's class."""
    return Path(inspect.getfile(type(experiment)))


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


def _content(path: Path) -> bytes:
    content = path.read_bytes()
    return decisive(ast.parse(content)).encode() if path.suffix == ".py" else content


def _only_shows(path: Path, root: Path) -> bool:
    return path.parent == root / "tools/reproduce" and path.stem.split("_")[-1] in SHOWING


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
