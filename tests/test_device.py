"""Building programs, choosing devices and refusing what does not fit, where a driver says no too."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from kernels.device import Device
from kernels.errors import DeviceError
from kernels.source import telling_line

ROOT = Path(__file__).parents[1]


class TestPrograms:
    def test_work_from_a_folder_with_a_space(self, tmp_path: Path) -> None:
        """From a copy of the package, in a process of its own; the CPU's flavor of the FFT includes a file."""
        folder = tmp_path / "a folder, (copied)"
        shutil.copytree(ROOT / "kernels", folder / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
        program = (
            "import kernels.device, kernels.fft; "
            "kernels.fft.RealFFT(kernels.device.choose_device(), (16, 16, 16), flavor='cpu'); "
            "print(kernels.device.__file__)"
        )
        ended = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True)
        assert (ended.returncode, ended.stdout.strip()) == (0, str(folder / "kernels" / "device.py")), ended.stderr

    def test_are_built_once_per_context(self, device: Device) -> None:
        assert device.program("rotate", EDGE=16) is device.program("rotate", EDGE=16)
        assert device.program("rotate", EDGE=16) is not device.program("rotate", EDGE=32)
        other = Device(device.cl_device)
        assert other.program("rotate", EDGE=16) is not device.program("rotate", EDGE=16)

    def test_carry_the_build_log_in_the_error(self, device: Device) -> None:
        with pytest.raises(DeviceError, match="'broken' did not build on") as raised:
            device.build("__kernel void f(__global float* x) { x[0] = missing_name; }", name="broken")
        assert "missing_name" in str(raised.value)


@pytest.mark.parametrize(
    ("log", "line"),
    [
        ("remark: fine\nx.cl:1: error: no such thing\nDevice x failed to build\n", "x.cl:1: error: no such thing"),
        ("Invalid build option: space\n", "Invalid build option: space"),
        ("", "clBuildProgram failed: INVALID_BUILD_OPTIONS"),
    ],
)
def test_the_line_that_tells_is_found_in_a_build_log(log: str, line: str) -> None:
    text = f"clBuildProgram failed: INVALID_BUILD_OPTIONS\n\nBuild on <pyopencl.Device 'x'>:\n\n{log}\n(options: -I /a)"
    assert telling_line(text) == line
    assert telling_line(f"{text}\n(source saved as /tmp/x.cl)") == line
