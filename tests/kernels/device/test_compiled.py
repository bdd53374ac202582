"""Compiling: every program without a warning in both flavors, and what is said of it, once."""

import functools
import logging
from pathlib import Path

import pytest

from sonarmap.kernels.device import cache, compiled
from sonarmap.kernels.device import device as device_module
from sonarmap.kernels.device.compiled import build_warnings
from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.source import KERNEL_FOLDER

PROGRAMS = sorted(path.relative_to(KERNEL_FOLDER).with_suffix("").as_posix() for path in KERNEL_FOLDER.rglob("*.cl"))
MISSPELLED = "__kernel __attribute__((reqd_workgroup_size(32, 1, 1))) void f(__global float* x) { x[0] = SEED; }"


def begin_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget what was built and said, as a process of its own would."""
    monkeypatch.setattr(device_module, "_opened", functools.cache(device_module._opened.__wrapped__))
    monkeypatch.setattr(compiled, "_said", set())


@pytest.fixture
def said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> list[str]:
    """What is logged, on a machine and in a process in which nothing was compiled."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    begin_process(monkeypatch)
    caplog.set_level(logging.INFO, "sonarmap")
    messages: list[str] = []
    monkeypatch.setattr(cache.LOGGER, "handle", lambda record: messages.append(record.getMessage()))
    return messages


@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_build_without_a_warning(device: Device, name: str) -> None:
    assert not build_warnings(device.program(name))


def test_a_warning_is_shown_with_what_it_means_and_not_again_in_another_process(device, said, monkeypatch):
    for seed in (3, 5):  # the same of another shape
        program = Device(device.cl_device).build(MISSPELLED, (f"-DSEED={seed}",), "wrong")
        (line,) = build_warnings(program)
    (message,) = said[1:]
    assert message.startswith(
        f"the OpenCL compiler of {device.name} warns of the program 'wrong': {line}. It is not an error"
    )
    assert "unknown attribute 'reqd_workgroup_size' ignored" in line
    assert "kcache" not in line  # the place of the driver's own copy
    begin_process(monkeypatch)
    Device(device.cl_device).build(MISSPELLED, ("-DSEED=3",), "wrong")
    assert len(said) == 2
    Device(device.cl_device).build(MISSPELLED, ("-DSEED=4",), "wrong")
    assert len(said) == 4
