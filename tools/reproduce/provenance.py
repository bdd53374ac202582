"""Where an experiment's rows come from: its settings, the code, the device, and what is installed."""

import hashlib
import inspect
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kernels.opencl.device import Device
from tools.bench.machine import describe_machine
from tools.methods.sources import ROOT, digest_of, imported, programs
from tools.reproduce.experiment import Experiment
from tools.versions import package_versions
from tools.writers.json_text import to_json


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
