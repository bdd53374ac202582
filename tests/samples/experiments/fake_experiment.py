"""A tiny experiment, to test how experiments are run and written: five jobs of seeded numbers, no device."""

import os
import signal
from types import SimpleNamespace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.experiments import Experiment, Outcome, Request
from sonarmap.tools.lab.reproduce.run import Provenance

JOBS = ("a", "b", "c", "d", "e")
ran: list[str] = []  # the jobs that were run in this process


def fake(seed: int = 1, end: str = "", outcomes: dict[str, Outcome] | None = None) -> Experiment:
    """`end`, as in "kill c", ends job c by "kill", "error" or "interrupt"; `outcomes` replaces the jobs."""
    how, _, last = end.partition(" ")

    def run(job: str) -> Outcome:
        if job == last and how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if job == last:
            raise InputError(f"no scene is called {job!r}") if how == "error" else KeyboardInterrupt
        ran.append(job)
        if outcomes:
            return outcomes[job]
        value = float(np.random.default_rng([seed, JOBS.index(job)]).normal())
        row = {"job": job, "value": value, "high": value > 0, "gap": float("nan") if job == "b" else 0.1 + 0.2}
        return Outcome((row,), ({"job": job, "seconds": 0.25},))

    return Experiment("fake", SimpleNamespace(seed=seed), list(outcomes or JOBS), run, ())


def create(request: Request) -> Experiment:
    return fake(1 if request.seed is None else request.seed, request.scene or "")


def origin(experiment: Experiment, **changes: object) -> Provenance:
    """Provenance of a fake experiment on an invented device."""
    fixed = {"sources": "ab", "device": "a device", "platform": "OpenCL 3.0 X  Y", "versions": {"numpy": "2"}}
    machine = {"processor": "a processor", "cores": 2}
    return Provenance(**({"name": "fake", "settings": vars(experiment.settings)} | fixed | machine | changes))
