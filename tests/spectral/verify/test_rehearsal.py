"""The rehearsal of a hypothesis test in another process, where its kernels were never compiled."""

from collections.abc import Callable

import numpy as np
import pyopencl as cl
import pytest

from sonarmap.kernels.device.device import choose_device
from sonarmap.spectral.grid import Grid
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.scan import Scan
from sonarmap.spectral.verify import rehearsal

EDGE = 64
Launch = tuple[int, str, tuple[int, ...]]  # program, kernel and work-group, which PoCL compiles for


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], set[Launch]]:
    """A function that runs another one, and returns the kernels that it launches."""
    launches: set[Launch] = set()
    plain = cl.Kernel.__call__

    def noted(kernel: cl.Kernel, queue: cl.CommandQueue, size: tuple, group: tuple, *arguments: object) -> cl.Event:
        launches.add((kernel.program.int_ptr, kernel.function_name, tuple(group)))
        return plain(kernel, queue, size, group, *arguments)

    def run(function: Callable[[], object]) -> set[Launch]:
        launches.clear()
        function()
        return set(launches)

    monkeypatch.setattr(cl.Kernel, "__call__", noted)
    return run


def scan(seed: int) -> Scan:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-9, 9, (2, 20_000))
    z = 2.5 * np.sin(0.35 * x + 0.4) + 0.012 * (y + 3) ** 2 * (x > -2) + 3.0 * ((x - 3) ** 2 + (y + 4) ** 2 < 9)
    return Scan(np.column_stack([x, y, z]).astype(np.float32))


def test_all_kernels_behind_the_rotations_are_rehearsed(launched: Callable) -> None:
    device = choose_device()
    if not device.is_cpu:
        pytest.skip("only processors have a rehearsal")
    rehearsed = launched(lambda: rehearsal.main([device.selector, str(EDGE)]))
    registrar = SpectralRegistrar(device, Grid(EDGE, 0.4))
    target, source = registrar.prepare(scan(0)), registrar.prepare(scan(1))
    registration = launched(lambda: registrar.register(target, source))
    assert {name for _, name, _ in registration - rehearsed} == {"multiply", "synthesize", "local_maxima"}


@pytest.mark.parametrize("spared", ["", "known", "one core", "large"])
def test_rehearsal_starts_only_where_it_helps(monkeypatch: pytest.MonkeyPatch, spared: str) -> None:
    device, started = choose_device(), list[list[str]]()
    if device.cl_device.platform.name != rehearsal._POCL or not device.is_cpu:
        pytest.skip("only PoCL's processors have a rehearsal")

    class Process:
        def __init__(self, command: list[str], **_: object) -> None:
            started.append(command)

        def kill(self) -> None:
            pass

    monkeypatch.setattr(rehearsal.subprocess, "Popen", Process)
    monkeypatch.setattr(rehearsal, "are_new", lambda _: spared != "known")
    monkeypatch.setattr(rehearsal, "thread_count", lambda: 1 if spared == "one core" else 2)
    monkeypatch.setattr(rehearsal, "_ROOM", 10**6 if spared == "large" else 1)
    rehearsal.rehearse_apart(device, EDGE)
    assert [command[-2:] for command in started] == ([] if spared else [[device.selector, str(EDGE)]])
