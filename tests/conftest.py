"""The device that tests share, and the end of runs that hang or lose a worker."""

import faulthandler
import os
import signal
from collections import Counter
from functools import cache
from typing import Any

import pytest

from sonarmap.kernels.device.device import Device, Flavor, choose_device

# A shell in the background makes tests ignore Ctrl-C, and nohup a closed terminal; programs that they start inherit it.
for _number, _usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(_number) == signal.SIG_IGN:
        signal.signal(_number, _usual)

GRACE = 30.0  # seconds between a test's timeout and the end of its process
STDERR = pytest.StashKey[int]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[STDERR] = os.dup(2)  # before pytest captures what is written to it


def pytest_timeout_set_timer(item: pytest.Item, settings: Any) -> None:
    """End the process of a test that hangs in native code, which the signal of pytest-timeout does not interrupt."""
    faulthandler.dump_traceback_later(settings.timeout + GRACE, file=item.config.stash[STDERR], exit=True)


def pytest_timeout_cancel_timer() -> None:
    faulthandler.cancel_dump_traceback_later()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:
    """End the run where a worker dies: pytest-xdist can lose its tests, and would then wait forever."""
    if error:
        schedule = node.config.pluginmanager.getplugin("dsession").sched
        test = schedule.remove_node(node) if node in schedule.nodes else None
        pytest.exit(f"worker {node.gateway.id} died ({error}) in {test or 'no test'}", returncode=1)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run tests of kernels in both flavors on a CPU; the flavor for GPUs is slow there, with the same results.

    A process loads one driver, so tests run on one device: PYOPENCL_CTX chooses another.
    """
    if "device" not in metafunc.fixturenames or not metafunc.definition.nodeid.startswith("tests/kernels/"):
        return
    if choose_device().is_cpu:
        metafunc.parametrize("device", [None, "gpu"], ids=["own", "gpu"], indirect=True, scope="session")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as slow cases beyond `quick_cases`, and all but one test per folder of kernels in the second flavor."""
    counts: Counter[tuple[str, bool]] = Counter()
    for item in items:
        if item.get_closest_marker("slow"):
            continue
        cases, kernel = getattr(item, "callspec", None), item.nodeid.startswith("tests/kernels/")
        second = bool(kernel and cases and cases.params.get("device") == "gpu")
        test = item.nodeid.rpartition("/")[0] if second else item.nodeid.partition("[")[0]
        counts[test, second] += 1
        given = item.get_closest_marker("quick_cases")
        if counts[test, second] > (1 if second else given.args[0] if given else counts[test, second]):
            item.add_marker(pytest.mark.slow)


@cache
def opened(flavor: Flavor | None) -> Device:
    device = choose_device()
    return Device(device.cl_device, device.selector, flavor=flavor) if flavor else device


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> Device:
    return opened(getattr(request, "param", None))
