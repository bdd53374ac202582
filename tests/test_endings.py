"""A run of the tests ends, whatever becomes of a worker: it fails, and names the test that the worker died in."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.samples.command_line import ROOT

LIMIT = 120  # seconds; without load it takes eight, of which pytest-xdist waits five for the other worker
CONFTEST = "from tests import conftest\nfrom tests.conftest import *\nconftest.GRACE = 2\n"
BUSY = "def test_busy():\n    import time\n    time.sleep(1000)\n"
ENDS = "import os\nos.environ['PYTEST_XDIST_WORKER'] == 'gw1' and os._exit(0)\n"
LOCK = "mutex = ctypes.create_string_buffer(64)\n    [ctypes.PyDLL(None).pthread_mutex_lock(mutex) for _ in range(2)]"
# What a test does, the file beside its own, the timeout of a test [s], and where the worker died
CASES = {
    "aborts": ("os.abort()", "", 1000, "test_b.py::test_dies"),
    "is killed": ("os.kill(os.getpid(), 9)", BUSY, 1000, "test_b.py::test_dies"),
    "hangs in native code": (LOCK, "", 2, "test_b.py::test_dies"),
    "ends as it begins": ("pass", ENDS, 1000, "no test"),
}


def run(case: str, folder: Path) -> subprocess.CompletedProcess[str]:
    body, beside, timeout, _ = CASES[case]
    folder.mkdir()
    (folder / "conftest.py").write_text(CONFTEST)
    (folder / "test_a.py").write_text("def test_passes(): pass\n")
    (folder / "test_b.py").write_text(f"import ctypes, os\ndef test_passes(): pass\ndef test_dies():\n    {body}\n")
    (folder / "test_c.py").write_text(beside)
    options = ["-c", ROOT / "pyproject.toml", "--rootdir", folder, "-o", f"timeout={timeout}"]
    return subprocess.run(
        [sys.executable, "-m", "pytest", *options, "-n", "2", "--dist", "loadfile", folder],
        cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=LIMIT,
    )  # fmt: skip


@pytest.mark.slow
def test_a_worker_that_dies_ends_the_run(tmp_path: Path) -> None:
    with ThreadPoolExecutor(len(CASES)) as pool:
        runs = {case: pool.submit(run, case, tmp_path / case.replace(" ", "_")) for case in CASES}
    for case, (*_, place) in CASES.items():
        ended = runs[case].result()
        assert ended.returncode == 1, f"{case}: {ended.stdout}"
        assert f"died (Not properly terminated) in {place} " in ended.stdout.splitlines()[-1], case
