"""`sonarmap doctor`, and `sonarmap map`, where disks are full, homes read-only, and memory or files limited."""

import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sonarmap.tools.command.doctor.storage import look_at
from sonarmap.tools.files.memory import available_memory, memory_limits
from tests.tools.command.doctor.broken import sonarmap
from tests.tools.command.doctor.test_doctor import commands_of, examined, quick


@contextmanager
def mounted(folder: Path, options: str) -> Iterator[Path]:
    """A file system in memory, where this user may mount one."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    try:
        refused = os.name != "posix" or subprocess.run(command, capture_output=True, check=False).returncode
    except OSError:
        refused = True
    if refused:
        pytest.skip("this user cannot mount file systems")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture
def scans(tmp_path: Path) -> Path:
    """Three scans of a rough bed."""
    rng = np.random.default_rng(5)
    (tmp_path / "scans").mkdir()
    for k in range(3):
        xy = rng.uniform(-20, 20, (3000, 2))
        z = 2 * np.sin((xy[:, 0] + k) / 3) * np.cos(xy[:, 1] / 5) - 8
        np.save(tmp_path / "scans" / f"{k}.npy", np.column_stack([xy, z]))
    return tmp_path / "scans"


class TestDisks:
    @pytest.mark.slow
    def test_a_full_disk(self, tmp_path: Path, scans: Path) -> None:
        with mounted(tmp_path / "full", "size=64k") as full:
            place = look_at(full / "out")
            assert (place.verdict, place.free) == ("wrong", 64 << 10)
            shown = sonarmap("doctor", str(full / "out"), "--json", "--quick")
            disk = examined(shown)["disk"]
            assert (shown.returncode, disk["verdict"]) == (2, "wrong")
            assert disk["seen"] == f"{full / 'out'}: 64 KiB free"
            made = sonarmap("map", str(scans), "--grid", "32", "-o", str(full / "out"), "--quiet")
            assert made.returncode == 2
            assert "'sonarmap doctor OUT' looks at a folder OUT and its disk" in made.stderr
            assert "Traceback" not in made.stderr

    @pytest.mark.slow
    def test_a_full_disk_of_temporary_files(self, tmp_path: Path) -> None:
        with mounted(tmp_path / "full", "size=64k") as full:
            (full / "rest").write_bytes(bytes(60 << 10))
            checks = quick(variables={"TMPDIR": str(full)})
            assert checks["temporary"]["verdict"] == "wrong"
            assert commands_of(checks["temporary"]) == ["export TMPDIR=/var/tmp"]

    @pytest.mark.slow
    def test_a_read_only_home(self, tmp_path: Path) -> None:
        with mounted(tmp_path / "home", "ro") as home:
            environment = {"HOME": str(home), "XDG_CACHE_HOME": "", "MPLCONFIGDIR": ""}
            shown = sonarmap("doctor", "--json", "--quick", variables=environment)
            caches = examined(shown)["caches"]
            assert (shown.returncode, caches["verdict"]) == (0, "warning")
            assert caches["seen"].startswith(f"read-only file system: sonarmap {home}/.cache/sonarmap, PyOpenCL ")
            assert f"PoCL {home}/.cache/pocl/kcache" in caches["seen"]
            assert re.match(r"export XDG_CACHE_HOME=\S+ MPLCONFIGDIR=\S+/matplotlib$", commands_of(caches)[0])
            devices = sonarmap("devices", variables=environment)
            assert devices.returncode == 0
            assert "cannot be written (read-only file system)" in devices.stderr
            assert "'sonarmap doctor' looks at them" in devices.stderr

    def test_a_file_in_place_of_the_folder(self, tmp_path: Path) -> None:
        (tmp_path / "out").touch()
        assert look_at(tmp_path / "out" / "map").fault == f"{tmp_path / 'out'} is a file, not a folder"

    def test_a_folder_of_another_user(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(path: Path) -> bool:
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(Path, "exists", refuse)
        assert look_at(tmp_path).fault == "permission denied"

    @pytest.mark.slow  # all kernels are compiled
    def test_a_map_with_a_read_only_home(self, tmp_path: Path, scans: Path) -> None:
        with mounted(tmp_path / "home", "ro") as home:
            environment = {"HOME": str(home), "XDG_CACHE_HOME": "", "MPLCONFIGDIR": ""}
            out = str(tmp_path / "out")
            made = sonarmap("map", str(scans), "--grid", "32", "-o", out, variables=environment)
            assert "cannot be written (read-only file system)" in made.stderr
            assert "Traceback" not in made.stderr
            assert (tmp_path / "out" / "map.ply").exists()


class TestMemory:
    @pytest.mark.slow
    def test_a_limit_of_addresses(self, scans: Path, tmp_path: Path) -> None:
        shown = sonarmap("doctor", "--json", "--quick", limit="-v 500000")
        checks = examined(shown)
        memory = checks["memory"]
        assert (shown.returncode, memory["verdict"]) == (2, "wrong")
        # a driver that says something else of it misleads
        assert (checks["OpenCL"]["remedies"], checks["OpenCL"]["seen"].endswith("; see memory")) == ([], True)
        assert "ulimit -v allows 488 MiB; too little for sonarmap" in memory["seen"]
        assert commands_of(memory) == ["ulimit -v unlimited"]
        made = sonarmap("map", str(scans), "--grid", "32", "-o", str(tmp_path / "out"), limit="-v 500000")
        assert made.returncode == 2
        assert "'sonarmap doctor' says" in made.stderr
        assert "Traceback" not in made.stderr

    def test_limits_of_control_groups(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        """Version 2: 1,000 MiB, of which 700 are used, 50 of these for files that need not stay."""

        group = tmp_path / "a" / "b"
        group.mkdir(parents=True)
        (tmp_path / "own").write_text("0::/a/b\n")
        (group / "memory.max").write_text(f"{1000 << 20}\n")
        (group / "memory.current").write_text(f"{700 << 20}\n")
        (group / "memory.stat").write_text(f"anon 5\ninactive_file {50 << 20}\nactive_file 7\n")
        monkeypatch.setattr("sonarmap.tools.files.memory._GROUPS", tmp_path)
        monkeypatch.setattr("sonarmap.tools.files.memory._OWN_GROUP", tmp_path / "own")
        assert memory_limits()["the control group"] == (1000 << 20, 650 << 20)
        assert available_memory() == 350 << 20
        (group / "memory.max").write_text("max\n")
        assert "the control group" not in memory_limits()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "check", "verdict", "command", "opencl"),
    [
        ({"limit": "-f 20000"}, "disk", "wrong", "ulimit -f unlimited$", ""),
        ({"variables": {"SONARMAP_THREADS": "two"}}, "cores", "wrong", "unset SONARMAP_THREADS$",
         "the environment's SONARMAP_THREADS is 'two'"),
        ({"variables": {"PYOPENCL_CTX": "abacus"}}, "OpenCL", "wrong", "unset PYOPENCL_CTX$",
         "no OpenCL device matches 'abacus'"),
    ],
)  # fmt: skip
def test_a_limit_or_a_variable(machine: dict[str, Any], check: str, verdict: str, command: str, opencl: str) -> None:
    checks = quick(**machine)
    commands = commands_of(checks[check])
    assert checks[check]["verdict"] == verdict
    assert re.match(command, commands[0])
    assert len(commands) == 1
    assert checks["OpenCL"]["seen"].startswith(opencl)
