"""Every program compiles without a warning, in both flavors."""

import pyopencl as cl
import pytest

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.source import KERNEL_FOLDER

PROGRAMS = sorted(path.relative_to(KERNEL_FOLDER).with_suffix("").as_posix() for path in KERNEL_FOLDER.rglob("*.cl"))
MISSPELLED = "__kernel __attribute__((reqd_workgroup_size(32, 1, 1))) void f(__global float* x) { x[0] = 0; }"


def build_log(device: Device, program: cl.Program) -> str:
    return str(program.get_build_info(device.cl_device, cl.program_build_info.LOG)).lower()


@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_build_without_a_warning(device: Device, name: str) -> None:
    assert "warning" not in build_log(device, device.program(name))


def test_log_contains_warnings(device: Device) -> None:
    assert "warning" in build_log(device, device.build(MISSPELLED))
