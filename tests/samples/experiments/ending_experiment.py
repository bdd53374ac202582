"""The fake experiment as a worker process makes it: the scene says at which job it ends, and how."""

import os
import signal

from sonarmap.kernels.errors import InputError
from sonarmap.tools.lab.reproduce.experiment import Outcome
from sonarmap.tools.lab.reproduce.experiments import Request
from tests.samples.experiments.fake_experiment import Fake


class Ending(Fake):
    """Ends at a job: with the scene "c" by an interrupt, with "error c" by an error, with "kill c" by a signal."""

    def __init__(self, end: str, job: str) -> None:
        super().__init__(stop=job if not end else "")
        self.end, self.job = end, job

    def run(self, job: str) -> Outcome:
        if job == self.job and self.end == "error":
            raise InputError(f"no scene is called {job!r}")
        if job == self.job and self.end == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        return super().run(job)


def create(request: Request) -> Fake:
    end, _, job = (request.scene or "").rpartition(" ")
    return Ending(end, job)
