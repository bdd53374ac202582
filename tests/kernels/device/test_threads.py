"""The number of threads of a process, and the share of the cores of parallel processes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sonarmap.kernels.device import threads
from sonarmap.kernels.device.device import list_devices
from sonarmap.kernels.device.threads import limit_libraries, share_cores, thread_count
from sonarmap.slam.execute.processes import spawned
from tests.samples.places import ROOT
from tests.samples.refusals import refuses

LIBRARIES = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@pytest.fixture
def cores(monkeypatch: pytest.MonkeyPatch) -> int:
    """A machine of 12 cores, and an environment without limits."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(12)), raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 12)
    monkeypatch.setattr(threads, "_QUOTA", Path("/nowhere"))
    for name in ("SONARMAP_THREADS", *LIBRARIES):
        monkeypatch.delenv(name, raising=False)
    return 12


@pytest.mark.parametrize(("processes", "share"), [(1, 12), (2, 6), (5, 2), (30, 1)])
def test_processes_share_the_cores(cores: int, monkeypatch: pytest.MonkeyPatch, processes: int, share: int) -> None:
    assert thread_count() == cores
    monkeypatch.setenv("OMP_NUM_THREADS", "7")  # set by the user
    share_cores(processes)
    assert thread_count() == share
    assert [os.environ.pop(name) for name in LIBRARIES] == [str(share), str(share), "7", str(share)]
    del os.environ["SONARMAP_THREADS"]


def test_processes_share_what_their_parent_may_use(cores: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes inherit the environment of a parent that has loaded its libraries."""
    monkeypatch.setenv("SONARMAP_THREADS", "6")
    limit_libraries()
    share_cores(3)
    assert thread_count() == 2
    assert [os.environ.pop(name) for name in LIBRARIES] == ["2"] * 4


@pytest.mark.parametrize("text", ["0", "two"])
def test_invalid_thread_count_is_refused(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("SONARMAP_THREADS", text)
    refuses("SONARMAP_THREADS is .* whole number above 0", thread_count)


@pytest.mark.parametrize(
    ("quota", "share"),
    [("max 100000", 12), ("250000 100000", 3), ("50000 100000", 1), ("9900000 100000", 12), ("", 12)],
)
def test_container_limits_the_threads(cores, monkeypatch, tmp_path, quota, share):
    (tmp_path / "cpu.max").write_text(quota)
    monkeypatch.setattr(threads, "_QUOTA", tmp_path / "cpu.max")
    assert thread_count() == share
    limit_libraries()  # by default, libraries use the whole machine
    assert [os.environ.pop(name, None) for name in LIBRARIES] == [None if share == cores else str(share)] * 4


def test_new_processes_use_their_share() -> None:
    count = thread_count()
    with spawned(2) as pool:
        assert pool.submit(thread_count).result() == max(1, count // 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "variables"),
    [("pass", {"SONARMAP_THREADS": "1"}), ("os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])", {})],
    ids=["as the variable says", "as the cores that it may use"],
)
def test_pocl_respects_the_limit(first: str, variables: dict[str, str]) -> None:
    if first != "pass" and (not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2):
        pytest.skip("this process can be given no fewer cores than it has")
    pocl = [info for info in list_devices() if "portable" in info.platform.lower() and not info.fault]
    if not pocl:
        pytest.skip("PoCL is not installed")
    program = (
        f"import os; {first}\nfrom sonarmap.kernels.device.device import choose_device\n"
        f"print(choose_device({pocl[0].selector!r}).cl_device.max_compute_units)"
    )
    environment = {name: value for name, value in os.environ.items() if name not in (*LIBRARIES, "SONARMAP_THREADS")}
    environment |= variables
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("1\n", "")
