"""What is made of the answers of the other process: drivers that crash, hang, or print what they like."""

from pathlib import Path
from typing import Any

import pytest

import sonarmap.tools.command.doctor.opencl as opencl_check
from sonarmap.kernels.child import Answers
from sonarmap.tools.command.doctor.finding import Finding, Remedy, size, worst
from sonarmap.tools.command.doctor.run import lines_of, summary

DEVICE: dict[str, Any] = {
    "selector": "0:0",
    "name": "a processor",
    "platform": "PoCL",
    "version": "OpenCL 3.0, driver 5.1",
    "kind": "cpu",
    "compute_units": 6,
    "driver_file": "/etc/OpenCL/vendors/pocl.icd",
    "fault": "",
    "self_test": "passed",
}
USABLE = ({"devices": [DEVICE]}, {"chosen": "0:0"}, {"largest": 512, "pairs": [[128, 5]]})


def judged(monkeypatch: pytest.MonkeyPatch, *steps: dict[str, Any], end: str = "") -> Finding:
    monkeypatch.setattr(opencl_check, "ask", lambda *_, **__: Answers(steps, end))
    return opencl_check.opencl(test=True)[0]


class TestOpenCL:
    def test_a_driver_that_crashes_while_it_is_tested(self, monkeypatch: pytest.MonkeyPatch) -> None:
        steps = {"begins": "loading PyOpenCL"}, {"begins": "testing the devices"}
        finding = judged(monkeypatch, *steps, end="it ended with SIGSEGV")
        assert (finding.verdict, finding.seen) == ("wrong", "while testing the devices: it ended with SIGSEGV")
        assert finding.remedies

    def test_a_driver_that_crashes_when_all_is_done(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Some do at the end of the process; by then the device has worked."""
        finding = judged(monkeypatch, *USABLE, end="it ended with SIGSEGV")
        assert finding.verdict == "ok"
        assert "0:0 a processor (cpu, 6 units), PoCL 5.1: self-test passed" in finding.seen

    def test_a_second_driver_that_cannot_be_loaded_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        fault = "libnvidia-opencl.so.1: cannot open shared object file: No such file or directory"
        driver = DEVICE | {"selector": "1", "name": "nvidia.icd", "compute_units": 0, "fault": fault}
        finding = judged(monkeypatch, {"devices": [DEVICE, driver]}, *USABLE[1:])
        assert (finding.verdict, f"not used: 1 nvidia.icd: {fault}" in finding.seen) == ("ok", True)

    def test_nothing_where_drivers_are_looked_for(self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
        monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path / "gone"))
        finding = judged(monkeypatch, {"unavailable": "no OpenCL platform was found"})
        assert finding.seen == f"no driver: {tmp_path / 'gone'}, where OCL_ICD_VENDORS points, is not there"
        assert finding.remedies[0].command == "unset OCL_ICD_VENDORS"

    def test_under_a_limit_of_memory_nothing_else_is_blamed(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(opencl_check, "memory_is_short", lambda: True)
        finding = judged(monkeypatch, {"unavailable": "no OpenCL platform was found"})
        assert (finding.remedies, finding.seen.endswith("; see memory")) == ((), True)


class TestWords:
    def test_commands_stand_alone_and_whole(self) -> None:
        command = "a " * 60 + "b"
        lines = lines_of(
            Finding("wrong", "one " * 40 + "\ntwo", (Remedy("do:", command), Remedy("or this")), check="disk"), 80
        )
        assert lines[0].startswith("wrong    disk        one one")
        assert [line.strip() for line in lines[-4:]] == ["two", "> do:", command, "> or this"]
        assert max(len(line) for line in lines if command not in line) <= 80

    def test_the_last_line(self) -> None:
        good, bad, doubtful = (Finding(verdict, "") for verdict in ("ok", "wrong", "warning"))
        assert summary([good, good]).endswith("all that is needed works")
        assert summary([good, doubtful]).endswith("all that is needed works; 1 warning")
        assert summary([good, bad, doubtful]).endswith("1 of 3 wrong, and 1 warning; follow the advice after >")
        assert (worst([]), worst(["ok", "warning", "ok"])) == ("ok", "warning")

    def test_sizes(self) -> None:
        sizes = {0: "0 bytes", 1023: "1023 bytes", 65536: "64 KiB", 1.5 * 2**20: "1.5 MiB", 3 * 2**34: "48 GiB"}
        assert {n: size(n) for n in sizes} == sizes
