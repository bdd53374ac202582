"""The memory plan of a registration against its allocations."""

import gc
from typing import Any

import numpy as np
import pytest

from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.device.trace import MemoryUsage
from sonarmap.kernels.errors import DeviceError
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.hemisphere import HemisphereRegistrar
from sonarmap.spectral.memory import POINTS, memory_plan, require_memory
from sonarmap.spectral.registration import SpectralConfig, SpectralRegistrar
from sonarmap.spectral.scan import Scan
from tests.samples.scenes.structures import structure

HARDLY = 1 - 1e-9  # a probability that no pair has: so all looks at a pair are taken
MAKERS: dict[str, tuple[Any, ...]] = {  # a registrar, its config, and the method of its plan
    "any rotation": (SpectralRegistrar, SpectralConfig(np.pi, least_probability=HARDLY), "spectral"),
    "hemisphere": (HemisphereRegistrar, None, "hemisphere"),
}


def prepared_with_second(registrar: Any, scan: Scan) -> Any:
    """A prepared scan, also on the coarser grid, if there is one."""
    prepared = registrar.prepare(scan)
    if isinstance(registrar, SpectralRegistrar):
        prepared.second()
    return prepared


@pytest.mark.parametrize(
    ("maker", "edge"),
    [("any rotation", 64), ("any rotation", 90), ("any rotation", 256), *((m, 128) for m in MAKERS)],
)
@pytest.mark.slow
def test_a_plan_holds_what_is_allocated(maker: str, edge: int) -> None:
    """The plan covers a prepared scan and the peak of a pair, and exceeds them by little."""
    chosen = choose_device()
    device = Device(chosen.cl_device, chosen.selector)  # without the tables that other tests left
    usage, (make, config, method) = MemoryUsage(device), MAKERS[maker]
    scans = [Scan(np.concatenate([structure(seed, 8000)] * 20)[:POINTS]) for seed in (1, 2)]
    plan = memory_plan(edge, method)
    registrar = make(device, Grid(edge, 25.6 / edge), config)
    target = prepared_with_second(registrar, scans[0])
    gc.collect()
    before = usage.now
    source = prepared_with_second(registrar, scans[1])
    gc.collect()
    of_scan = usage.now - before
    registrar.register(target, source)
    measured = np.array([of_scan, usage.most, usage.largest])
    planned = np.array([plan.scan, plan.pair, plan.largest])
    assert (measured < 1.1 * planned).all()
    assert (planned[:2] < 1.5 * measured[:2]).all()


def test_the_error_for_a_too_large_grid_names_the_memory_and_a_grid_that_fits() -> None:
    with pytest.raises(DeviceError, match=r"GiB on the device.*`edge=\d\d\d`"):
        require_memory(_Small(), memory_plan(512))


class _Small:
    """A device of 2 GiB."""

    name = "small"

    def require(self, largest: int, total: int, hint: str) -> None:
        if total > 2 * 2**30:
            raise DeviceError(f"this needs {total / 2**30:.2f} GiB on the device. Use {hint}.")
