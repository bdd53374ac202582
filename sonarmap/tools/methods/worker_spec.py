"""What workers in other processes make a method from; workers of a cluster check that they make the same."""

from functools import partial
from typing import TYPE_CHECKING

from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.worker_spec import WorkerSpec
from sonarmap.tools.methods.fingerprint import method_key
from sonarmap.tools.methods.registry import Setup, find_method

if TYPE_CHECKING:
    from sonarmap.spectral.result import Registrar


def worker_spec(name: str, setup: Setup, registrar: "Registrar", prepared: int) -> WorkerSpec:
    """For workers on this machine.

    Args:
        name: a key of METHODS.
        setup: what the registrar was made from.
        registrar: the method as this process has it.
        prepared: how many prepared scans a worker keeps.
    """
    return WorkerSpec(partial(find_method(name).make, setup), method_key(name, setup, registrar), prepared)


def checked_worker_spec(name: str, setup: Setup, registrar: "Registrar", prepared: int) -> WorkerSpec:
    """For workers on other machines, as `worker_spec`: one whose code, versions or device differ refuses to work."""
    key = method_key(name, setup, registrar)
    return WorkerSpec(partial(_make_the_same, name, setup, key), key, prepared)


def _make_the_same(name: str, setup: Setup, key: str) -> "Registrar":
    registrar = find_method(name).make(setup)
    if method_key(name, setup, registrar) != key:
        device = getattr(registrar, "device", None)
        raise InputError(
            "a worker of the cluster would not get the results of this machine: its sonarmap, its packages' versions "
            f"or its device{f' ({device.name}, {device.platform})' if device else ''} differ. Install the same there, "
            "and choose the same kind of device with `device`."
        )
    return registrar
