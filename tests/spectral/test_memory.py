"""What is reckoned with before registering, beside what a registration then allocates."""

import gc
import weakref
from collections.abc import Callable, Iterator

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
import pytest

from kernels.device.device import Device, choose_device
from kernels.errors import DeviceError
from kernels.fft.edges import EDGES
from spectral.grid import Grid
from spectral.hemisphere.registration import HemisphereConfig, HemisphereRegistrar
from spectral.memory import needed_memory, prepared_memory, require_memory, scans_that_fit
from spectral.registration import SpectralConfig, SpectralRegistrar
from spectral.result import Registrar
from spectral.scan import Scan
from tests.samples.structures import structure

MAKERS: dict[str, Callable[[Device, Grid], Registrar]] = {
    "rotations": lambda device, grid: SpectralRegistrar(device, grid),
    "any rotation": lambda device, grid: SpectralRegistrar(device, grid, SpectralConfig(max_tilt=np.pi)),
    "hemisphere": lambda device, grid: HemisphereRegistrar(device, grid),
    "paper": lambda device, grid: HemisphereRegistrar(device, grid, HemisphereConfig.paper()),
}


class Usage:
    """Bytes on the device: now, and at most."""

    def __init__(self) -> None:
        self.now, self.most, self.largest = 0, 0, 0

    def give(self, size: int) -> None:
        self.now += size
        self.most, self.largest = max(self.most, self.now), max(self.largest, size)

    def take(self, size: int) -> None:
        self.now -= size


class Watched(cl.Buffer):
    """A buffer that can be watched until it is gone."""


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Device, Usage]]:
    """A device of its own, without tables kept from other tests, and what is allocated on it."""
    first, usage = choose_device(), Usage()
    device = Device(first.cl_device, first.selector)
    empty, upload = cla.empty, cla.to_device

    def allocate(size: int) -> cl.Buffer:
        buffer = Watched(device.context, cl.mem_flags.READ_WRITE, size)
        usage.give(size)
        weakref.finalize(buffer, usage.take, size)
        return buffer

    monkeypatch.setattr(cla, "empty", lambda queue, shape, dtype, **_: empty(queue, shape, dtype, allocator=allocate))
    monkeypatch.setattr(
        cla, "to_device", lambda queue, host, async_: upload(queue, host, allocator=allocate, async_=async_)
    )
    yield device, usage
    gc.collect()


@pytest.mark.parametrize(
    ("maker", "edge"),
    [
        ("any rotation", 64),
        ("hemisphere", 64),
        ("any rotation", 50),
        *(pytest.param(maker, 90, marks=pytest.mark.slow) for maker in MAKERS),
        *(pytest.param(maker, edge, marks=pytest.mark.slow) for maker in MAKERS for edge in (32, 128)),
    ],
)
def test_a_registration_takes_no_more_than_expected(watched: tuple[Device, Usage], maker: str, edge: int) -> None:
    device, usage = watched
    registrar = MAKERS[maker](device, Grid(edge, 25.6 / edge))
    first, second = (registrar.prepare(Scan(structure(seed, 8000))) for seed in (1, 2))
    registrar.register(first, second)
    gc.collect()
    before = usage.now
    third = registrar.prepare(Scan(structure(3, 8000)))
    gc.collect()
    assert 0 < usage.now - before <= prepared_memory(edge)
    registrar.register(first, third)
    largest, total = needed_memory(edge)
    assert usage.largest <= largest
    assert usage.most - (usage.now - before) <= total


@pytest.mark.slow
@pytest.mark.parametrize("maker", ["any rotation", "hemisphere"])
def test_not_much_more_is_expected_than_is_taken(watched: tuple[Device, Usage], maker: str) -> None:
    """On a grid whose volumes outweigh the tables; a device that could do it must not be refused."""
    device, usage = watched
    registrar = MAKERS[maker](device, Grid(256, 0.1))
    prepared = [registrar.prepare(Scan(structure(seed, 8000))) for seed in (1, 2)]
    registrar.register(*prepared)
    _, total = needed_memory(256)
    assert 0.6 * total < usage.most <= total


def test_larger_grids_need_more_and_leave_room_for_fewer_scans() -> None:
    device = choose_device()
    needs = [needed_memory(edge) for edge in EDGES]
    assert needs == sorted(needs)
    fitting = [scans_that_fit(device, edge) for edge in EDGES]
    assert fitting == sorted(fitting, reverse=True)


def test_a_grid_too_large_says_what_is_needed_and_what_would_fit() -> None:
    with pytest.raises(DeviceError, match=r"GiB on the device.*`edge=2\d\d`"):
        require_memory(_Small(), 512)  # pyright: ignore[reportArgumentType]


class _Small:
    """A device of 1 GiB."""

    name = "small"

    def require(self, largest: int, total: int, hint: str) -> None:
        if total > 2**30:
            raise DeviceError(f"this needs {total / 2**30:.2f} GiB on the device. Use {hint}.")
