"""Drivers that crash, hang, fail or are missing, tried in separate processes, and what is remembered of them."""

import os
import shutil
import subprocess
import sys
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from sonarmap.kernels.child import Answers
from sonarmap.kernels.device import trial
from sonarmap.kernels.device.cache import cache_folder
from sonarmap.kernels.device.device import choose_device, list_devices
from sonarmap.kernels.device.device_info import DeviceInfo
from sonarmap.kernels.device.drivers import Driver, loaded_driver
from sonarmap.kernels.errors import DeviceError
from tests.samples.places import ROOT

CRASHES = {
    "when it is loaded": "__attribute__((constructor)) static void f(void) { abort(); }",
    "by an exit": "#include <unistd.h>\n__attribute__((constructor)) static void f(void) { _exit(0); }",
    "when it is asked": "void* clGetExtensionFunctionAddress(const char* name) { abort(); return 0; }",
}
GPUS = [DeviceInfo(f"0:{n}", f"card {n}", kind="gpu", compute_units=8, driver_version="1.0") for n in range(3)]


@cache
def known() -> list[DeviceInfo]:
    """The devices of the tests' driver."""
    choose_device()
    driver = loaded_driver()
    assert driver is not None
    return [info for info in trial.known_devices() if info.driver_file == driver.file]


@pytest.fixture(autouse=True)
def _nothing_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)


@pytest.fixture
def drivers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the .icd file of the tests' driver, to which other drivers can be added."""
    folder, own = tmp_path / "vendors", trial.driver_of(known()[0])
    if not own.library:
        pytest.skip("the driver of these tests has no .icd file")
    folder.mkdir()
    (folder / "good.icd").write_text(own.library)
    monkeypatch.setenv("OCL_ICD_VENDORS", str(folder))
    return folder


def add_stub(folder: Path, name: str, source: str) -> None:
    """Compile a driver, and write its .icd file to a folder."""
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc to compile a driver that crashes")
    library = folder.parent / f"lib{name}.so"
    code = f"#include <stdlib.h>\n{source}\n"
    subprocess.run(["gcc", "-shared", "-fPIC", "-xc", "-", "-o", library], input=code.encode(), check=True)
    (folder / f"{name}.icd").write_text(str(library))


def chosen_in_a_new_process() -> subprocess.CompletedProcess[str]:
    """Run a process that chooses a device and prints its selector."""
    program = "from sonarmap.kernels.device.device import choose_device; print(choose_device().selector)"
    return subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=200)


def answering(monkeypatch: pytest.MonkeyPatch, *answers: Answers) -> list[tuple[str, ...]]:
    """Replace processes by these answers, in turn; returns the list of arguments that they will get."""
    asked: list[tuple[str, ...]] = []
    waiting = list(answers)

    def ask(_: str, *arguments: str, seconds: float) -> Answers:
        asked.append(arguments)
        return waiting.pop(0)

    monkeypatch.setattr(trial, "ask", ask)
    monkeypatch.setattr(trial, "installed_drivers", lambda: [Driver("a.icd", "liba.so")])
    return asked


def found(*infos: DeviceInfo) -> dict[str, Any]:
    return {"found": [asdict(info) for info in infos]}


def test_hanging_driver_is_waited_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Until its file changes or the machine restarts; `devices --test` tries it again."""
    asked = answering(monkeypatch, *[Answers((), "it did not answer within 60 s")] * 2)
    for look in (list_devices, lambda: list_devices(test=True, again=False)):
        (info,) = look()
        assert "did not answer within 60 s; 'sonarmap devices --test' tries it once more" in info.fault
        with pytest.raises(DeviceError, match="no OpenCL device works"):
            choose_device()
        assert len(asked) == 1
    list_devices(test=True)
    assert len(asked) == 2


class TestDrivers:
    @pytest.mark.slow
    @pytest.mark.parametrize("when", CRASHES)
    def test_crashing_driver_is_reported_and_another_used(self, drivers: Path, when: str) -> None:
        add_stub(drivers, "crash", CRASHES[when])
        (drivers / "absent.icd").write_text("libnowhere.so")
        (drivers / "zero.icd").write_text("a\0b")
        (drivers / "other.icd").write_text("libm.so.6")
        ended = chosen_in_a_new_process()
        assert (ended.returncode, ended.stdout) == (0, "2:0\n"), ended.stderr
        assert (
            f"the OpenCL driver {drivers / 'crash.icd'} is not used: the process that tried it failed" in ended.stderr
        )
        assert f"the OpenCL driver {drivers / 'absent.icd'} is not used: libnowhere.so: cannot open" in ended.stderr
        assert f"{drivers / 'other.icd'} is not used: libm.so.6 is no OpenCL driver" in ended.stderr
        assert f"{drivers / 'zero.icd'} names no library" in ended.stderr
        again = chosen_in_a_new_process()
        assert (again.stdout, again.stderr) == ("2:0\n", "")  # it is tried and reported only once
        absent, crash, good, other, zero = list_devices()
        assert [info.selector for info in (absent, crash, good, other, zero)] == ["0", "1", "2:0", "3", "4"]
        end = "exit code 0" if when == "by an exit" else "SIGABRT"
        assert crash.fault == f"the process that tried it failed: it ended with {end}"
        assert (good.fault, good.driver_file) == ("", str(drivers / "good.icd"))

    @pytest.mark.slow
    def test_only_driver_crashes_or_hangs(self, drivers: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (drivers / "good.icd").unlink()
        add_stub(drivers, "crash", CRASHES["when it is loaded"])
        with pytest.raises(DeviceError, match=r"no OpenCL device works\. 0 crash.icd does not work: .* SIGABRT"):
            choose_device()
        add_stub(drivers, "crash", '__attribute__((constructor)) static void f(void) { for (;;) system("sleep 1"); }')
        monkeypatch.setattr(trial, "_SECONDS", 2.0)
        (hung,) = list_devices()
        assert hung.fault.startswith("the process that tried it failed: it did not answer within 2 s; ")


class TestTrials:
    def test_devices_after_a_crash_are_tried(self, monkeypatch: pytest.MonkeyPatch) -> None:
        first = found(*GPUS), {"begins": "0:0"}, {"tried": ["0:0", ""]}, {"begins": "0:1"}
        second = found(*GPUS), {"begins": "0:2"}, {"tried": ["0:2", "a trial kernel gave wrong numbers"]}
        asked = answering(monkeypatch, Answers(first, "it ended with SIGSEGV"), Answers(second, ""))
        faults = [info.fault.rpartition(": ")[2] for info in list_devices()]
        assert faults == ["", "it ended with SIGSEGV", "a trial kernel gave wrong numbers"]
        assert [arguments[3] for arguments in asked] == ["0", "2"]
        ended = "it ended with SIGSEGV"  # before the others are tried
        answering(monkeypatch, Answers((found(*GPUS), {"begins": "0:0"}), ended), Answers((), ended))
        assert all(info.fault for info in list_devices())

    @pytest.mark.parametrize("done", [True, False])
    def test_crash_during_a_self_test_fails_it_and_one_afterwards_does_not(self, monkeypatch, done):
        steps = found(GPUS[0]), {"begins": "0:0"}, {"tried": ["0:0", ""]}, {"tested": ["0:0", "passed", ""]}
        ended = Answers(steps if done else steps[:-1], "it ended with SIGSEGV")
        answering(monkeypatch, Answers(steps[:-1], ""), ended)
        (info,) = list_devices(test=True)
        reason = "" if done else "the process that tried it failed: it ended with SIGSEGV"
        fault = "" if done else f"its self-test failed: {reason}"
        assert (info.fault, info.self_test) == (fault, "passed" if done else "failed")
        assert trial.self_test_of(info.identity)[1] == reason


class TestMemory:
    def trials(self, monkeypatch: pytest.MonkeyPatch) -> int:
        """Number of trials that listing the devices takes."""
        count = 0
        actual = trial._try

        def counted(*given: Any) -> Any:
            nonlocal count
            count += 1
            return actual(*given)

        with monkeypatch.context() as patch:
            patch.setattr(trial, "_try", counted)
            trial.known_devices()
        return count

    @pytest.mark.slow
    def test_trial_is_remembered_until_something_changes(self, drivers, monkeypatch):
        assert [self.trials(monkeypatch) for _ in range(2)] == [1, 0]
        os.utime(drivers / "good.icd", ns=(1, 1))
        assert [self.trials(monkeypatch) for _ in range(2)] == [1, 0]
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "1")
        assert [self.trials(monkeypatch) for _ in range(2)] == [1, 0]

    @pytest.mark.slow
    def test_broken_devices_are_tried_again_if_none_works(self, drivers):
        trial.known_devices()
        (name,) = [path.stem for path in cache_folder().glob("driver-*.json")]
        broken = [asdict(known()[0]) | {"fault": "it was broken then"}]
        driver = Driver(str(drivers / "good.icd"), (drivers / "good.icd").read_text())
        trial.remember(name, {"digest": trial._digest(driver, broken), "devices": broken})
        assert trial.known_devices()[0].fault == "it was broken then"
        assert chosen_in_a_new_process().stdout == "0:0\n"
