"""Fingerprints of everything that affects a result, and the specification of a method for worker processes.

These are code, settings, device and installed versions. Code is digested by whole folders: a changed comment causes
results to be computed again, but no change that matters is missed."""

import hashlib
import inspect
import json
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sonarmap.slam.execute.worker import WorkerSpec
from sonarmap.tools.files.user_file import package_versions
from sonarmap.tools.files.writers.tables import to_json
from sonarmap.tools.methods.registry import Setup, find_method

if TYPE_CHECKING:
    from sonarmap.spectral.result import Registrar

ROOT = Path(__file__).parents[2]


def fingerprint(value: Any) -> str:
    """The digest of any value that `to_json` accepts, 64 hexadecimal digits."""
    return hashlib.sha256(json.dumps(to_json(value), sort_keys=True).encode()).hexdigest()


@cache
def source_digest(places: Sequence[str], root: Path = ROOT) -> str:
    """The digest of the Python files, OpenCL programs and tables in `places`, as of the first call: the running code.

    The places are folders and files, relative to the root. Raises FileNotFoundError: a place does not exist.
    """
    digest = hashlib.sha256()
    for path in sorted({path for place in places for path in _source_files(root / place)}):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def method_sources(name: str) -> tuple[str, str]:
    """Digests of a method's files and of the code in the registry that builds it."""
    method = find_method(name)
    builder = method.make if inspect.isfunction(method.make) else type(method.make)
    return source_digest(method.sources), fingerprint(
        [inspect.getsource(builder), "" if inspect.isfunction(method.make) else repr(method.make)]
    )


def method_versions(name: str) -> dict[str, str | None]:
    """The versions that a method's results depend on, without sonarmap's own, whose code has a digest."""
    method = find_method(name)
    unused = {"sonarmap", "gtsam", "system"} | (set() if "device" in method.options else {"pyopencl"})
    versions = package_versions(*filter(None, [method.package]))
    return {package: version for package, version in versions.items() if package not in unused}


def method_key(name: str, setup: Setup, registrar: "Registrar") -> str:
    """The digest of everything that affects a registration: method, settings, code, device, driver and versions.

    `registrar` is the method that this process built from `setup`.
    """
    device = getattr(registrar, "device", None)
    return fingerprint(
        {
            "method": name,
            "grid": setup.grid,
            "settings": getattr(registrar, "config", None),
            "seed": setup.seed if "seed" in find_method(name).options else None,
            "sources": method_sources(name),
            "device": [device.name, device.platform] if device else None,
            "versions": method_versions(name),
        }
    )


def _source_files(place: Path) -> list[Path]:
    if place.is_file():
        return [place]
    if not place.is_dir():
        raise FileNotFoundError(f"{place} is neither a folder nor a file; a list of sources names it")
    return [path for path in place.rglob("*") if path.suffix in (".py", ".cl", ".json")]


def worker_spec(name: str, setup: Setup, registrar: "Registrar", prepared: int) -> WorkerSpec:
    """The specification of workers that each keep `prepared` prepared scans; other arguments as in `method_key`."""
    return WorkerSpec(partial(find_method(name).make, setup), method_key(name, setup, registrar), prepared)
