"""The fake experiment as a process of a crew makes it: the scene says at which job it stops, and how."""

import os
import signal

from kernels.errors import InputError
from tests.samples.fake_experiment import Fake
from tools.reproduce.experiment import Outcome
from tools.reproduce.experiments import Request


class Ending(Fake):
    """Ends at a job: "c" with an interrupt, "error c" with an error, "kill c" at once."""

    def __init__(self, way: str, job: str) -> None:
        super().__init__(stop=job if not way else "")
        self.way, self.job = way, job

    def run(self, job: str) -> Outcome:
        if job == self.job and self.way == "error":
            raise InputError(f"no scene is called {job!r}")
        if job == self.job and self.way == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        return super().run(job)


def create(request: Request) -> Fake:
    way, _, job = (request.scene or "").rpartition(" ")
    return Ending(way, job)
