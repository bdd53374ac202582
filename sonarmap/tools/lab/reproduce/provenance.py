"""Where an experiment's rows come from: its settings, the code, the device, and what is installed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sonarmap.kernels.device.device import Device
from sonarmap.tools.files.inputs import package_versions
from sonarmap.tools.files.writers.tables import to_json
from sonarmap.tools.lab.bench.machine import count_cores, processor_name
from sonarmap.tools.lab.reproduce.experiment import Experiment
from sonarmap.tools.methods.fingerprint import fingerprint, method_sources, method_versions, source_digest
from sonarmap.tools.methods.registry import find_method


@dataclass(frozen=True, slots=True)
class Provenance:
    """What has to be the same for rows to be the same, and the machine for people."""

    name: str  # the experiment's
    settings: Mapping[str, Any]  # its settings in JSON's types
    sources: str  # digest of the code that decides rows
    # device, platform: the OpenCL device and its driver
    device: str
    platform: str
    versions: Mapping[str, str | None]  # of Python, the system and the packages
    # processor, cores: the host's; they decide nothing
    processor: str
    cores: int
    # where jobs are of one method each, a digest of all that decides the rows of each, by its name
    methods: Mapping[str, str] = field(default_factory=dict)

    def key(self, job: str) -> str:
        """A digest of all that decides the rows of a job; of a method's jobs without what decides others alone."""
        whole = [self.settings, self.sources, self.device, self.platform, self.versions]
        return fingerprint([self.name, self.methods.get(job.rpartition("/")[2], whole), job])

    @property
    def place(self) -> str:
        """The machine in a few words: of the driver's long text what stands before its features."""
        host = f"{self.processor}, {self.cores} cores" if self.processor else f"{self.cores} cores"
        driver = self.platform.split("  ")[0].split(",")[0]
        return f"{self.device} ({driver}; {host})"


def provenance(experiment: Experiment, device: Device) -> Provenance:
    """Of an experiment on a device, with the code that runs now."""
    sources = source_digest(experiment.sources)
    return Provenance(
        name=experiment.name,
        settings=to_json(vars(experiment.settings)),
        sources=sources,
        device=device.name,
        platform=device.platform,
        versions=package_versions(),
        processor=processor_name(),
        cores=count_cores(),
        methods={name: _method_fingerprint(experiment, name, sources, device) for name in experiment.methods},
    )


def _method_fingerprint(experiment: Experiment, name: str, sources: str, device: Device) -> str:
    """Of one method's rows; a method that uses no device has the same rows with every one."""
    used = [device.name, device.platform] if "device" in find_method(name).options else None
    deciding = {setting: getattr(experiment.settings, setting) for setting in experiment.deciding}
    return fingerprint([deciding, sources, method_sources(name), method_versions(name), used])
