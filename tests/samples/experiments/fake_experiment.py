"""A tiny experiment, to test how experiments are run and written: five jobs of seeded numbers, no device."""

import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from sonarmap.tools.lab.reproduce.experiment import Experiment, Outcome, Row, Section
from sonarmap.tools.lab.reproduce.experiments import Request
from sonarmap.tools.lab.reproduce.provenance import Provenance
from sonarmap.tools.lab.reproduce.rows import column
from sonarmap.tools.lab.reproduce.table import Table

JOBS = ("a", "b", "c", "d", "e")


@dataclass(frozen=True, slots=True)
class FakeSettings:
    seed: int = 1
    fast: bool = False


class Fake(Experiment):
    """Counts what it does; where `stop` names a job, that job ends as `by` says."""

    name: ClassVar[str] = "fake"
    sources: ClassVar[tuple[str, ...]] = ()

    def __init__(self, settings: FakeSettings | None = None, stop: str = "", by: str = "interrupt") -> None:
        super().__init__(settings or FakeSettings())
        self.stop, self.by = stop, by
        self.ran: list[str] = []

    def jobs(self) -> Sequence[str]:
        return JOBS

    def run(self, job: str) -> Outcome:
        if job == self.stop:
            if self.by == "kill":
                os.kill(os.getpid(), signal.SIGKILL)
            raise KeyboardInterrupt
        self.ran.append(job)
        value = float(np.random.default_rng([self.settings.seed, JOBS.index(job)]).normal())
        row = {"job": job, "value": value, "high": value > 0, "gap": float("nan") if job == "b" else 0.1 + 0.2}
        return Outcome((row,), ({"job": job, "seconds": 0.25},))

    def section(self, rows: Sequence[Row], seconds: Sequence[Row]) -> Section:
        mean = np.mean(column(rows, "value"))
        return Section(
            title="A fake, Fig. 0",
            tables=(
                Table("Claims", ("what", "paper", "ours, mean", "verdict"), (("mean", "0", f"{mean:.6f}", "so"),)),
            ),
            times=(Table("Times", ("jobs", "s"), (("5", "1.25"),)),),
            pictures={"fake.png": "The numbers.", "fake-2.png": "The numbers | again."},
        )

    def draw(self, folder: Path, rows: Sequence[Row]) -> None:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(1, 1))
        figure.subplots().plot(column(rows, "value"))
        for name in ("fake.png", "fake-2.png"):
            figure.savefig(folder / name)


def create(request: Request) -> Fake:
    return Fake(FakeSettings(1 if request.seed is None else request.seed, request.quick))


def origin(fake: Fake, **changes: object) -> Provenance:
    """Of a fake, on a device that is not there."""
    settings = {"seed": fake.settings.seed, "fast": fake.settings.fast}
    fixed = {"sources": "ab", "device": "a device", "platform": "OpenCL 3.0 X  Y", "versions": {"numpy": "2"}}
    machine = {"processor": "a processor", "cores": 2}
    return Provenance(**({"name": "fake", "settings": settings} | fixed | machine | changes))  # pyright: ignore
