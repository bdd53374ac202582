"""Timed stages, and counts of a device's launches, reads and writes."""

import time

import numpy as np
import pytest

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.device.trace import Counts, tracing
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.tools.lab.bench.stages import BUILDS, PAIR_STAGES, SURVEY_STAGES, clocked, places


@pytest.fixture(scope="module")
def profiled() -> Device:
    """A device whose queue records times."""
    chosen = choose_device()
    return Device(chosen.cl_device, chosen.selector, profiling=True)


class TestTrace:
    def test_launches_reads_writes_and_bytes_are_counted(self, profiled: Device) -> None:
        volume, points = profiled.empty((16, 16, 16)), profiled.to_device(np.zeros((5, 4), np.float32))
        counts = Counts()
        with tracing(profiled, lambda: counts):
            voxelize(profiled, points, 16, out=volume)
            counts.launches = counts.array_bytes = 0
            fft = RealFFT(profiled, (16, 16, 16))
            spectrum = fft.forward(volume)
            held = spectrum.get()
            profiled.to_device(np.ones(3, np.float32))
            profiled.queue.finish()
        assert held.nbytes == 8 * 16 * 16 * 16
        assert counts.launches == 2
        assert counts.array_bytes == 2 * (volume.nbytes + spectrum.nbytes)
        assert counts.reads == 2  # the spectrum, and the end of the queue
        assert counts.writes == 1
        assert all(seconds > 0 for seconds in counts.kernel_seconds().values())


def _inner() -> None:
    time.sleep(0.01)


class _Outer:
    def work(self) -> str:
        time.sleep(0.005)
        _inner()
        _inner()
        return "done"


class TestClock:
    def test_own_time_excludes_nested_stages(self) -> None:
        here = __name__
        with clocked({f"{here}:_Outer.work": "outer", f"{here}:_inner": "inner"}) as clock:
            assert _Outer().work() == "done"
        _inner()
        outer, inner = clock.stages["outer"], clock.stages["inner"]
        assert (outer.calls, inner.calls) == (1, 2)
        assert inner.seconds >= 0.02
        assert outer.seconds == pytest.approx(outer.own_seconds + inner.seconds)
        assert outer.own_seconds >= 0.005

    def test_every_stage_names_existing_functions(self) -> None:
        """After renaming a function, rename it in tools/lab/bench/stages.py too."""
        for place in (*PAIR_STAGES, *SURVEY_STAGES, *BUILDS):
            assert all(callable(function) for _, _, function in places(place))
