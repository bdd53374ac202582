"""What a user names is read where it is a file, or a pipe on purpose; what never ends or never begins is refused."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.command.main import read_settings
from sonarmap.tools.files.readers.csv_table import read_csv_table
from sonarmap.tools.files.readers.g2o import read_g2o
from sonarmap.tools.files.readers.navigation.overview import read_navigation
from sonarmap.tools.files.readers.navigation.settings import AS_IT_SAYS
from sonarmap.tools.files.readers.selection import BAG_METADATA, is_bag_folder
from sonarmap.tools.files.readers.trajectory import read_tum
from sonarmap.tools.files.user_file import read_content, read_json, sha256_of
from tests.samples.clutter_scans import sonarmap
from tests.samples.refusals import refuses

READERS: dict[str, Callable[[Path], object]] = {
    "navigation": lambda path: read_navigation(path, AS_IT_SAYS, None, np.zeros(1), []),
    "table": read_csv_table,
    "g2o": read_g2o,
    "tum": read_tum,
    "json": lambda path: read_json(path, "a summary"),
    "settings": lambda path: read_settings(path, {}),
    "digest": sha256_of,
}


@pytest.mark.parametrize("name", READERS)
def test_pipes_and_devices_are_refused_before_they_are_opened(name: str, tmp_path: Path) -> None:
    """One would be waited for until somebody writes, the other read until memory ends."""
    os.mkfifo(tmp_path / "pipe.csv")
    for path in (tmp_path / "pipe.csv", Path("/dev/zero")):
        refuses(f"{path}: it is a pipe or a device; wanted a file", READERS[name], path)
    refuses("null", READERS[name], tmp_path / "a\0b")


def test_a_pipe_given_as_a_file_is_read_once(tmp_path: Path) -> None:
    """As `<(...)` of a shell; what is read twice cannot be one, and says so."""
    read, write = os.pipe()
    os.write(write, b"target,source\n1,2\n")
    os.close(write)
    assert read_csv_table(Path(f"/dev/fd/{read}")).rows[0].cells == ["1", "2"]
    refuses("it is a pipe", read_g2o, Path(f"/dev/fd/{read}"))
    os.close(read)
    read, write = os.pipe()
    os.write(write, b"[devices]\ngrid = 96\n")
    os.close(write)
    assert "grid is not an option of devices" in sonarmap("--config", f"/dev/fd/{read}", "devices").stderr
    os.close(read)
    assert read_content(Path(os.devnull), pipe=True) == b""


def test_a_file_larger_than_memory_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(1 << 43)
    refuses(r"large.csv takes 8,192 GiB of memory", read_csv_table, tmp_path / "large.csv")


def test_a_pipe_named_as_metadata_makes_no_bag_of_a_folder(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / BAG_METADATA)
    assert not is_bag_folder(tmp_path)
