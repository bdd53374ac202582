"""Which code decides the rows of one method: its own, and the experiment's; not that of the other methods."""

import ast
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from kernels.device import Device
from tools.methods import METHODS
from tools.reproduce.experiment import ByMethod, Experiment
from tools.reproduce.provenance import (
    ROOT,
    Provenance,
    decisive,
    digest_of,
    imported,
    imports,
    programs,
    provenance,
    source_of,
)
from tools.writers.summary import to_json

TABLE = Path("tools/methods.py")  # it imports every method's modules, each in a function of its own

# Packages that decide no registration, and those that decide none without a device
_IDLE = ("sonarmap", "gtsam")
_OF_DEVICES = ("pyopencl",)


def method_provenances(experiment: Experiment, device: Device) -> dict[str, Provenance]:
    """Where the rows of each method come from, by its name; nothing where the jobs are not of one method each.

    A method that chooses no device is the same on every one.
    """
    if not isinstance(experiment, ByMethod):
        return {}
    whole = provenance(experiment, device)
    return {name: _provenance(whole, experiment, name) for name in experiment.methods}


def method_digest(module: Path, make: str, on_device: bool, root: Path = ROOT) -> str:
    """A digest of all code that decides the rows of one method.

    Args:
        module: the experiment's file; what it imports counts, but for the table of methods.
        make: the function of the table that builds the method: it counts, with the functions that it calls, what
            these import, and what that imports.
        on_device: whether the OpenCL programs count.
        root: of the project.
    """
    table = root / TABLE
    called = _called(ast.parse(table.read_bytes()), make)
    modules = [file for function in called for file in imports(function, root)]
    files = imported([module.resolve(), *modules], root, [table])
    return digest_of({*files, *(programs(root) if on_device else ())}, root, "\n".join(map(decisive, called)))


def _provenance(whole: Provenance, experiment: ByMethod, name: str) -> Provenance:
    method = METHODS[name]
    on_device = "device" in method.hears
    idle = _IDLE if on_device else (*_IDLE, *_OF_DEVICES)
    return replace(
        whole,
        name=f"{whole.name}-{name}",
        settings=to_json(experiment.deciding),
        sources=method_digest(source_of(experiment), method.make.__name__, on_device),
        device=whole.device if on_device else "",
        platform=whole.platform if on_device else "",
        versions={package: one for package, one in whole.versions.items() if package not in idle}
        | _version(method.package),
    )


def _version(package: str) -> dict[str, str | None]:
    """Of a method's own package, if it has one."""
    try:
        return {package: version(package)} if package else {}
    except PackageNotFoundError:
        return {package: None}


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
