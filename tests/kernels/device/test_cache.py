"""The cache folders: if they cannot be written, a warning is logged once and work continues."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sonarmap.kernels.device import cache
from sonarmap.kernels.device.cache import cache_folder, kernel_cache, recall, remember
from tests.samples.places import ROOT

COMPUTE = """
import sonarmap, numpy, os
for _ in range(2):
    device = sonarmap.choose_device("cpu")
print(sonarmap.kernels.voxelize(device, device.to_device(numpy.zeros((1, 4), numpy.float32) + 1), 16).get().sum())
print(os.environ["XDG_CACHE_HOME"], os.environ.get("POCL_CACHE_DIR", ""))
"""


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_records_are_recalled_and_written_atomically(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Path) -> None:
        raise OSError(28, "No space left on device")

    assert recall("of a device") == {}
    remember("of a device", {"state": "passed", "n": [1, 2]})
    monkeypatch.setattr(Path, "replace", full)
    monkeypatch.setattr(cache, "_warned", set())
    remember("of a device", {"state": "failed"})
    assert recall("of a device") == {"state": "failed"}  # in this process
    monkeypatch.setattr(cache, "_unwritten", {})
    assert recall("of a device") == {"state": "passed", "n": [1, 2]}
    assert [path.name for path in cache_folder().iterdir()] == ["of a device.json"]


def test_caches_move_from_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files can be created there but not filled, and PoCL's compiler would end the process."""

    class Full(io.BytesIO):
        def write(self, *_: object) -> int:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(cache.tempfile, "TemporaryFile", lambda dir: Full())
    monkeypatch.setattr(cache, "_warned", set())
    monkeypatch.delenv("POCL_CACHE_DIR", raising=False)
    cache.require_caches()
    assert "sonarmap-cache-" in os.environ["XDG_CACHE_HOME"]
    assert not kernel_cache().is_relative_to(tmp_path)


@pytest.mark.parametrize("content", ["", "[1, 2]", '{"state": "pas'])
def test_damaged_records_are_empty(content: str) -> None:
    remember("of a device", {})
    (cache_folder() / "of a device.json").write_text(content)
    assert recall("of a device") == {}


@pytest.mark.slow
@pytest.mark.parametrize("variable", ["XDG_CACHE_HOME", "POCL_CACHE_DIR"])
def test_unwritable_folder_is_reported_once(variable: str, tmp_path: Path) -> None:
    """Without their cache folders PoCL lists no devices, and PyOpenCL builds no kernels."""
    (tmp_path / "file").write_text("")
    nowhere = tmp_path / "file" / "below"
    environment = {name: value for name, value in os.environ.items() if name != "POCL_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", COMPUTE],
        cwd=ROOT,
        env=environment | {variable: str(nowhere)},
        capture_output=True,
        text=True,
    )
    total, folders = done.stdout.splitlines()
    (warning,) = done.stderr.splitlines()
    assert total == "1.0"
    assert warning.startswith(f"the cache folder {nowhere}")
    assert "(not a directory)" in warning
    assert f"Set {variable} to a writable folder." in warning
    used = folders.split(" ")[0 if variable == "XDG_CACHE_HOME" else 1]
    assert "sonarmap-cache-" in used
    assert not Path(used).exists()  # removed when the process ended
