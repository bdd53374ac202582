"""What the tests share: the device they run on."""

import signal
from functools import cache

import pytest

from kernels.device.device import Device, Flavor, choose_device

# A shell that starts tests in the background has them ignore Ctrl-C, and so would the programs that they start.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A kernel's test runs in both flavors: a processor is forced into that of graphics processors, where it is slow
    and has the same numbers.

    A process loads one driver, so tests run on one device: PYOPENCL_CTX chooses another.
    """
    if "device" not in metafunc.fixturenames or not metafunc.definition.nodeid.startswith("tests/kernels/"):
        return
    if choose_device().is_cpu:
        metafunc.parametrize("device", [None, "gpu"], ids=["own", "gpu"], indirect=True, scope="session")


@cache
def opened(flavor: Flavor | None) -> Device:
    device = choose_device()
    return Device(device.cl_device, device.selector, flavor=flavor) if flavor else device


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> Device:
    return opened(getattr(request, "param", None))
