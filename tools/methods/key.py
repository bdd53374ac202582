"""A method as the workers of a crew make it, and the key of what its results depend on."""

import hashlib
import json
from collections.abc import Mapping
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from kernels.errors import InputError
from slam.execute.worker import WorkerSpec
from tools.methods.registry import Setup, find_method
from tools.methods.sources import method_digest
from tools.versions import package_versions
from tools.writers.json_text import to_json

if TYPE_CHECKING:
    from spectral.result import Registrar

# What decides no registration: the version, as the sources tell more, and where it runs.
_IDLE = ("sonarmap", "gtsam", "system")
# And what decides none without a device
_OF_DEVICES = ("pyopencl",)


def worker_spec(name: str, setup: Setup, registrar: "Registrar", prepared: int) -> WorkerSpec:
    """What workers on this machine make a registrar from.

    Args:
        name: a key of METHODS.
        setup: that the registrar was made from.
        registrar: the method as this process has it.
        prepared: how many prepared scans a worker keeps.
    """
    return WorkerSpec(partial(find_method(name).make, setup), method_key(name, setup, registrar), prepared)


def checked_worker_spec(name: str, setup: Setup, registrar: "Registrar", prepared: int) -> WorkerSpec:
    """As `worker_spec`, for workers elsewhere: one that would find something else refuses."""
    key = method_key(name, setup, registrar)
    return WorkerSpec(partial(_make_alike, name, setup, key), key, prepared)


def method_key(name: str, setup: Setup, registrar: "Registrar") -> str:
    """A digest of all that decides what a method finds in two scans.

    That is its name and settings, its code, the device with its driver, and the packages' versions.
    """
    text = json.dumps(to_json(_deciding(name, setup, registrar)), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _deciding(name: str, setup: Setup, registrar: "Registrar") -> Mapping[str, Any]:
    method = find_method(name)
    device = getattr(registrar, "device", None)
    idle = _IDLE if device else (*_IDLE, *_OF_DEVICES)
    versions = package_versions(*filter(None, [method.package]))
    return {
        "method": name,
        "grid": setup.grid,
        "settings": getattr(registrar, "config", None),
        "seed": setup.seed if "seed" in method.hears else None,
        "sources": _sources(name),
        "device": [device.name, device.platform] if device else None,
        "versions": {package: one for package, one in versions.items() if package not in idle},
    }


@cache
def _sources(name: str) -> str:
    """Of the code as it was when it was first asked for, which is what runs."""
    method = find_method(name)
    return method_digest(method.make.__name__, "device" in method.hears)


def _make_alike(name: str, setup: Setup, key: str) -> "Registrar":
    registrar = find_method(name).make(setup)
    if method_key(name, setup, registrar) != key:
        device = getattr(registrar, "device", None)
        raise InputError(
            "a worker of the cluster would not find what this machine finds: its sonarmap, its packages' versions or "
            f"its device{f' ({device.name}, {device.platform})' if device else ''} differ. Install the same there, and "
            "choose the same kind of device with --device."
        )
    return registrar
