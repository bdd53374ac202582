"""What is reckoned with before registering, beside what a registration then allocates."""

import gc
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.device.usage import MemoryUsage
from sonarmap.kernels.errors import DeviceError
from sonarmap.kernels.fft.edges import EDGES
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar
from sonarmap.spectral.memory import memory_plan, require_memory, scans_that_fit
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.structures import structure

TILT = float(np.deg2rad(35))
HARDLY = 1 - 1e-9  # a probability that no pair has: so all looks at a pair are taken
# A registrar, its config, and the method and tilt of its plan.
MAKERS: dict[str, tuple[Any, ...]] = {
    "spectral": (SpectralRegistrar, SpectralConfig(least_probability=HARDLY), "spectral", TILT),
    "any rotation": (SpectralRegistrar, SpectralConfig(np.pi, least_probability=HARDLY), "spectral", np.pi),
    "hemisphere": (HemisphereRegistrar, None, "hemisphere", np.pi),
    "paper": (HemisphereRegistrar, HemisphereConfig.paper(), "hemisphere", np.pi),
}


def prepared_with_second(registrar: Any, scan: Scan) -> Any:
    """A prepared scan, also for the second look, if there is one."""
    prepared = registrar.prepare(scan)
    if isinstance(registrar, SpectralRegistrar):
        prepared.second()
    return prepared


@pytest.mark.parametrize(
    ("maker", "edge"),
    [
        ("spectral", 32),
        *((maker, 90) for maker in MAKERS),
        ("spectral", 256),
        ("hemisphere", 128),
    ],
)
@pytest.mark.slow
def test_a_plan_is_within_a_tenth_of_what_is_allocated(maker: str, edge: int) -> None:
    """Of one prepared scan, and at most while two are prepared and registered; a term that is off is then named."""
    chosen = choose_device()
    device = Device(chosen.cl_device, chosen.selector)  # without the tables that other tests left
    usage, (make, config, method, tilt) = MemoryUsage(device), MAKERS[maker]
    scans = [Scan(structure(seed, 8000)) for seed in (1, 2)]
    plan = memory_plan(edge, method, round(np.mean([len(scan.points) for scan in scans])), tilt)
    registrar = make(device, Grid(edge, 25.6 / edge), config)
    target = prepared_with_second(registrar, scans[0])
    gc.collect()
    before = usage.now
    source = prepared_with_second(registrar, scans[1])
    gc.collect()
    off = f"allocated, by place:\n{usage.table(10_000)}\nplanned: {plan.terms()}"
    assert usage.now - before == pytest.approx(plan.scan, rel=0.1), off
    registrar.register(target, source)
    off = f"allocated, by place:\n{usage.table(10_000)}\nplanned: {plan.terms()}"
    assert usage.most == pytest.approx(plan.pair, rel=0.1), off
    assert usage.largest <= plan.largest, off


def test_counted_by_hand() -> None:
    chosen = choose_device()
    device = Device(chosen.cl_device, chosen.selector)
    usage = MemoryUsage(device)
    first = device.empty((3, 5, 7))
    second = device.to_device(np.ones(11, np.complex64))
    assert (usage.now, usage.most, usage.largest) == (420 + 88, 420 + 88, 420)
    del second
    gc.collect()
    assert (usage.now, usage.most) == (420, 508)
    assert sum(usage.at_most.values()) == 508
    assert all(place.startswith("spectral/test_memory.py:") for place in usage.at_most)
    usage.restart()
    assert (usage.most, usage.largest) == (first.nbytes, 0)


def test_larger_grids_need_more_and_leave_room_for_fewer_scans() -> None:
    device = choose_device()
    needs = [memory_plan(edge).pair for edge in EDGES]
    # where fewer volumes are worked on at once, as from 54 to 60, a larger grid may need a trifle less
    assert all(more > 0.999 * less for less, more in pairwise(needs))
    fitting = [scans_that_fit(device, edge) for edge in EDGES]
    assert fitting == sorted(fitting, reverse=True)
    assert memory_plan(512).pair < 8 * 2**30
    for method in ("spectral", "hemisphere"):
        plan = memory_plan(128, method)
        assert sum(plan.terms().values()) == plan.pair


def test_a_grid_too_large_says_what_is_needed_and_what_would_fit() -> None:
    with pytest.raises(DeviceError, match=r"GiB on the device.*`edge=\d\d\d`"):
        require_memory(_Small(), memory_plan(512))  # pyright: ignore[reportArgumentType]


class _Small:
    """A device of 2 GiB."""

    name = "small"

    def require(self, largest: int, total: int, hint: str) -> None:
        if total > 2 * 2**30:
            raise DeviceError(f"this needs {total / 2**30:.2f} GiB on the device. Use {hint}.")
