"""A survey whose registrar every worker can create: it knows the truth, and can fail on demand."""

import os
import signal
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sonarmap.kernels.errors import DeviceError
from sonarmap.slam.execute.worker import WorkerSpec
from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan
from tests.samples.surveys import KnowingRegistrar, random_covariance, ring_poses

COVARIANCE = random_covariance(np.random.default_rng(0), 0.004, 0.03)


class Knowing(KnowingRegistrar):
    """Appends a line per pair to a file; signatures are a scan's mean point. The ending "kill 5 6" ends the
    process at this pair; "device 5 6" and "stop 5 6" raise."""

    def __init__(self, count: int, notes: Path, ending: str = "") -> None:
        super().__init__(ring_poses(count), COVARIANCE, self._end, broken=("scan2",))
        self.notes, self.ending = notes, ending.split()

    def _end(self, i: int, j: int, given: Registration) -> Registration:
        with self.notes.open("a") as file:
            file.write(f"{i} {j}\n")
        if self.ending[1:] == [str(i), str(j)]:
            match self.ending[0]:
                case "kill":
                    os.kill(os.getpid(), signal.SIGKILL)
                case "device":
                    raise DeviceError("the device is full")
                case "stop":
                    raise KeyboardInterrupt
        return given

    def prepare(self, scan: Scan) -> Any:
        return super().prepare(scan), scan.points.mean(axis=0)

    def register(self, target: Any, source: Any) -> Registration:
        return super().register(target[0], source[0])

    def signature(self, prepared: Any) -> np.ndarray:
        return prepared[1]


def worker_spec(count: int, notes: Path, ending: str = "") -> WorkerSpec:
    return WorkerSpec(partial(Knowing, count, notes, ending), f"{count} {notes} {ending}", 3)
