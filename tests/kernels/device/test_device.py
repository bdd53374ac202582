"""Choosing devices, building programs, and refusing arrays that do not fit."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pyopencl.array as cla
import pytest

from sonarmap.kernels.device.device import Device, choose_device, list_devices
from sonarmap.kernels.device.device_info import DeviceInfo, by_preference, describe, matching
from sonarmap.kernels.device.drivers import Driver, load_devices, loaded_driver
from sonarmap.kernels.device.launch import zero
from sonarmap.kernels.device.source import informative_line
from sonarmap.kernels.errors import DeviceError
from tests.samples.places import ROOT


def fake(selector: str, kind: str, name: str, platform: str, driver: str = "1.0", **more: Any) -> DeviceInfo:
    """A device; its platform's version names the driver, as PoCL's does."""
    pocl = platform == "Portable Computing Language"
    version = f"OpenCL 3.0 PoCL {driver} LLVM" if pocl else "OpenCL 3.0 "
    vendor = "The pocl project" if pocl else platform
    given: dict[str, Any] = {"compute_units": 8, "clock": 1000, "vendor": vendor, "platform_version": version} | more
    return DeviceInfo(selector, name, platform, version, kind, driver_version=driver, **given)


POCL, CUDA = "Portable Computing Language", "NVIDIA CUDA"
MACHINE = [
    fake("0:0", "cpu", "pthread-AMD EPYC", POCL, "3.1"),
    fake("1:0", "other", "FPGA 7", "Intel(R) FPGA"),
    fake("2:0", "gpu", "GeForce RTX 3090", CUDA, "535.1", compute_units=82),
    fake("2:1", "gpu", "GeForce RTX 4090", CUDA, "535.1", compute_units=128),
    fake("3:0", "cpu", "AMD EPYC", POCL, "6.0"),
    DeviceInfo("4", "broken.icd", fault="libbroken.so: cannot open shared object file"),
]


class TestSelection:
    @pytest.mark.parametrize(
        ("selectors", "labels"),
        [
            (("",), "0:0 1:0 2:0 2:1 3:0 4"),
            (("2:1", " 2:1 ", "nvidia:1", "nvidia:rtx 40"), "2:1"),
            (("2", "rtx 3090", "3090"), "2:0"),
            (("cpu", "pocl", "portable", "pocl:0"), "0:0 3:0"),
            (("GPU", "cuda"), "2:0 2:1"),
            (("other",), "1:0 4"),
            (("pocl 6",), "3:0"),
            (("portable:pthread",), "0:0"),
            (("7",), "1:0"),
            (("4", "broken.icd"), "4"),
        ],
    )
    def test_every_form_of_selector(self, selectors: tuple[str, ...], labels: str) -> None:
        for wanted in selectors:
            assert " ".join(info.selector for info in matching(wanted, MACHINE)) == labels

    @pytest.mark.parametrize("wanted", ["2:4090", "309", "9:0", "abacus", ":0"])
    def test_lists_the_devices_if_none_matches(self, wanted: str) -> None:
        with pytest.raises(DeviceError, match=f"no OpenCL device matches '{wanted}'. There are: 0:0 pthread-AMD E"):
            matching(wanted, MACHINE)

    @pytest.mark.parametrize("wanted", ["2:0,1", "nvidia:0, 1", "0:0,1,2"])
    def test_refuses_several_devices(self, wanted: str) -> None:
        first = wanted.partition(",")[0]
        with pytest.raises(DeviceError, match=f"'{wanted}' names several .* choose one, as in '{first}'.*2:1 GeForce"):
            matching(wanted, MACHINE)

    def test_prefers_gpus_with_own_memory_then_larger_ones_and_newer_drivers(self) -> None:
        shared = fake("5:0", "gpu", "UHD", "Intel(R) OpenCL", compute_units=500, shares_memory=True)
        order = [info.selector for info in by_preference([shared, *MACHINE])]
        assert order == ["2:1", "2:0", "5:0", "3:0", "0:0", "1:0", "4"]

    def test_compares_drivers_of_one_vendor_only(self) -> None:
        intel = fake("0:0", "cpu", "Xeon", "Intel(R) OpenCL", "2024.17")
        old, candidate, new = (
            fake(f"{n}:0", "cpu", "Xeon", POCL, version) for n, version in enumerate(["3.9", "3.10-rc2", "3.10"], 1)
        )
        assert by_preference([old, intel, candidate, new]) == [new, candidate, old, intel]
        assert by_preference([intel, old, candidate, new]) == [intel, new, candidate, old]


class TestChoice:
    @pytest.fixture
    def twice(self, device: Device, monkeypatch: pytest.MonkeyPatch) -> list[DeviceInfo]:
        """The device of the tests, listed twice like two identical ones."""
        monkeypatch.delenv("PYOPENCL_CTX", raising=False)
        driver = loaded_driver()
        assert driver is not None
        one = replace(describe(device.cl_device, "0:0"), driver_file=driver.file)
        infos = [one, replace(one, selector="0:1")]
        monkeypatch.setattr("sonarmap.kernels.device.device.known_devices", lambda: infos)
        monkeypatch.setattr("sonarmap.kernels.device.device.try_devices", lambda: infos)
        monkeypatch.setattr(
            "sonarmap.kernels.device.device.load_devices", lambda _: [[device.cl_device, device.cl_device]]
        )
        return infos

    def test_tells_identical_devices_apart(self, twice, device, monkeypatch):
        chosen = choose_device("0:1")
        assert (chosen.selector, chosen.notes, chosen.cl_device) == ("0:1", (), device.cl_device)
        assert choose_device(device.name).selector == "0:0"
        monkeypatch.setenv("PYOPENCL_CTX", "0:1")
        assert choose_device().selector == "0:1"
        assert choose_device("0:0").selector == "0:0"

    def test_notes_say_that_a_broken_device_is_passed_over(self, twice: list[DeviceInfo]) -> None:
        twice[0] = replace(twice[0], fault="error: unknown target")
        chosen, name = choose_device(), twice[0].name
        note = f"0:0 {name} does not work: error: unknown target. 0:1 {name} is used instead."
        assert (chosen.selector, chosen.notes) == ("0:1", (note,))

    def test_refuses_if_no_device_works(self, twice: list[DeviceInfo]) -> None:
        twice[:] = [replace(info, fault="it smokes") for info in twice]
        with pytest.raises(DeviceError, match=r"no OpenCL device works\. 0:0 .*: it smokes; 0:1 .*: it smokes.*apt"):
            choose_device()
        with pytest.raises(DeviceError, match=r"no OpenCL device that matches '0:1' works. 0:1 "):
            choose_device("0:1")

    def test_a_process_loads_one_driver(self, twice: list[DeviceInfo]) -> None:
        twice[1] = replace(twice[1], name="a card", driver_file="card.icd")
        with pytest.raises(DeviceError, match=r"this process has loaded .*: use 0:1 a card in a separate process"):
            choose_device("0:1")
        assert choose_device().selector == "0:0"
        with pytest.raises(DeviceError, match="has loaded the OpenCL driver"):
            load_devices(Driver("card.icd", "libcard.so"))

    def test_device_that_is_gone_is_reported(self, twice: list[DeviceInfo], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("sonarmap.kernels.device.device.load_devices", lambda _: [])
        with pytest.raises(DeviceError, match=r"0:0 .* is gone; 'sonarmap devices' lists the remaining ones"):
            choose_device("0:0")

    def test_missing_driver_is_reported_with_packages(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
        for call in (choose_device, list_devices):
            with pytest.raises(DeviceError, match=r"no OpenCL driver was found.*pocl-opencl-icd.*intel-opencl-rt"):
                call()


class TestMemory:
    def test_large_arrays_are_refused_before_allocation(self, device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
        def taken(*_: object) -> None:
            raise AssertionError("memory was allocated")

        monkeypatch.setattr(cla, "empty", taken)
        limit = device.cl_device.max_mem_alloc_size
        need = f"{limit / 2**30 + 1:.2f} GiB"
        most = f"at most {limit / 2**30:.2f} GiB in one piece"
        with pytest.raises(DeviceError, match=f"needs {need} on the device, {need} .*{most}. Use a smaller `edge`"):
            device.empty((limit // 4 + 2**28,))
        with pytest.raises(DeviceError, match=r"Use --grid 64\."):
            device.require(2**20, device.memory + 1, hint="--grid 64")

    def test_failed_allocation_is_explained(self, device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
        def full(*_: object, **__: object) -> None:
            raise cl.MemoryError("create_buffer failed: MEM_OBJECT_ALLOCATION_FAILURE")

        monkeypatch.setattr(cla, "empty", full)
        monkeypatch.setattr(cl, "Buffer", full)
        for call in (lambda: device.empty((16,)), lambda: device.to_device(np.zeros(16, np.float32))):
            with pytest.raises(DeviceError, match=r"no memory or other resources left .*_FAILURE.*smaller `edge`"):
                call()


class TestPrograms:
    def test_work_from_a_folder_with_a_space(self, tmp_path: Path) -> None:
        """From a copy of the package, in another process."""
        folder = tmp_path / "a folder, (copied)"
        shutil.copytree(ROOT / "sonarmap", folder / "sonarmap", ignore=shutil.ignore_patterns("__pycache__"))
        program = (
            "import sonarmap.kernels.device.device; "
            "source = '#include \"device/complex.cl\"\\n__kernel void f(__global float* x) {}'; "
            "sonarmap.kernels.device.device.choose_device().build(source); "
            "print(sonarmap.kernels.device.device.__file__)"
        )
        ended = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True)
        place = folder / "sonarmap" / "kernels" / "device" / "device.py"
        assert (ended.returncode, ended.stdout.strip()) == (0, str(place)), ended.stderr

    def test_build_error_contains_the_log(self, device: Device) -> None:
        with pytest.raises(DeviceError, match="'broken' did not build on") as raised:
            device.build("__kernel void f(__global float* x) { x[0] = missing_name; }", name="broken")
        assert "missing_name" in str(raised.value)

    def test_are_built_once_per_process(self, device: Device) -> None:
        assert device.program("so3/peaks", EDGE=16) is device.program("so3/peaks", EDGE=16)
        assert device.program("so3/peaks", EDGE=16) is not device.program("so3/peaks", EDGE=32)
        other = Device(device.cl_device, flavor=device.flavor)
        assert other.program("so3/peaks", EDGE=16) is device.program("so3/peaks", EDGE=16)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_forked_process_is_refused_instead_of_hanging() -> None:
    device = choose_device()
    array = device.to_device(np.ones(4096, np.float32))
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        refused: list[str] = []
        for use in (choose_device, lambda: device.empty((4,)), lambda: zero(device, array)):
            try:
                use()
            except DeviceError as error:
                refused.append(str(error))
        os.write(writing, "\n".join(refused).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as answer:
        refusals = answer.read().splitlines()
    os.waitpid(child, 0)
    assert [refusal for refusal in refusals if "get_context('spawn')" in refusal] == refusals
    assert len(refusals) == 3


@pytest.mark.parametrize(
    ("log", "line"),
    [
        ("remark: fine\nx.cl:1: error: no such thing\nDevice x failed to build\n", "x.cl:1: error: no such thing"),
        ("Invalid build option: space\n", "Invalid build option: space"),
        ("", "clBuildProgram failed: INVALID_BUILD_OPTIONS"),
    ],
)
def test_informative_line_of_a_build_log(log: str, line: str) -> None:
    text = f"clBuildProgram failed: INVALID_BUILD_OPTIONS\n\nBuild on <pyopencl.Device 'x'>:\n\n{log}\n(options: -I /a)"
    assert informative_line(text) == line
    assert informative_line(f"{text}\n(source saved as /tmp/x.cl)") == line
