"""Which code decides the rows of one method: its own, and the experiment's; not that of the other methods."""

from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version

from kernels.opencl.device import Device
from tools.methods.registry import METHODS
from tools.methods.sources import method_digest
from tools.reproduce.experiment import ByMethod, Experiment
from tools.reproduce.provenance import Provenance, provenance, source_of
from tools.writers.json_text import to_json

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


def _provenance(whole: Provenance, experiment: ByMethod, name: str) -> Provenance:
    method = METHODS[name]
    on_device = "device" in method.hears
    idle = _IDLE if on_device else (*_IDLE, *_OF_DEVICES)
    return replace(
        whole,
        name=f"{whole.name}-{name}",
        settings=to_json(experiment.deciding),
        sources=method_digest(method.make.__name__, on_device, [source_of(experiment)]),
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
