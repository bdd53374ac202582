"""What the tests share: the devices they run on, and how a run ends that cannot go on."""

import faulthandler
import os
import signal
from functools import cache
from typing import Any

import pytest

from kernels.device.device import Device, Flavor, choose_device, list_devices
from kernels.errors import DeviceError

# A shell that starts tests in the background has them ignore Ctrl-C, and so would the programs that they start.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

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
    """End the run where a worker dies: pytest-xdist can lose the tests that it had, and then waits for ever."""
    if error:
        schedule = node.config.pluginmanager.getplugin("dsession").sched
        test = schedule.remove_node(node) if node in schedule.nodes else None
        pytest.exit(f"worker {node.gateway.id} died ({error}) in {test or 'no test'}", returncode=1)


@cache
def selectors() -> list[str | None]:
    """The devices that work, one of each kind; None: the one that is chosen by itself, or by PYOPENCL_CTX.

    Two drivers for one processor, as pip's PoCL beside the system's, are one device: the one that is chosen.
    """
    if os.environ.get("PYOPENCL_CTX"):
        return [None]
    try:
        working = [info for info in list_devices() if not info.fault]
        chosen = [choose_device("cpu").selector] if any(info.kind == "cpu" for info in working) else []
    except DeviceError:
        return [None]
    others = {(info.name, info.version): info.selector for info in working if info.kind != "cpu"}
    found = [*others.values(), *chosen]
    return list(found) if len(found) > 1 else [None]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Where several devices work, a test that takes `device` runs on each.

    A kernel's test runs in both flavors: a processor is forced into that of graphics processors, where it is slow and
    has the same numbers.
    """
    if "device" not in metafunc.fixturenames:
        return
    cases: list[tuple[str | None, Flavor | None]] = [(selector, None) for selector in selectors()]
    if metafunc.definition.nodeid.startswith("tests/kernels/"):
        for selector in selectors():
            if choose_device(selector).is_cpu:
                cases.append((selector, "gpu"))
    if len(cases) > 1:
        names = [f"{selector or 'device'}-{flavor or 'own'}" for selector, flavor in cases]
        metafunc.parametrize("device", cases, ids=names, indirect=True, scope="session")


@cache
def opened(selector: str | None, flavor: Flavor | None) -> Device:
    device = choose_device(selector)
    return Device(device.cl_device, device.selector, flavor=flavor) if flavor else device


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> Device:
    return opened(*getattr(request, "param", (None, None)))
