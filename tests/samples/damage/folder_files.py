"""Files that are read together with others of their folder, and settings, each with its reader."""

import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.main import app, read_settings
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.bags.samples import dive
from tests.samples.bags.writers import write_ros2
from tests.samples.cloud_files import las
from tests.samples.damage.pose_files import Readable
from tests.tools.products.export.finished import finished_map

_VERBS: Any = typer.main.get_command(app)
_SETTINGS = b"""[map]
grid = 96
max_tilt = 12.5  # degrees
method = "spectral"
mount = "0,0,180"
max-speed = 2
export = ["mcap", "g2o"]
report = false
[simulate]
seed = 5
"""


def folder_files() -> dict[str, Readable]:
    """Files by kind; `read` also writes the other files of the folder."""
    bag, packed, finished = _bag(""), _bag("file"), _map()
    return {
        "file of a bag": _one_of(bag, "dive.db3", _read_bag),
        "packed file of a bag": _one_of(packed, "dive.db3.zstd", _read_bag),
        "trajectory beside": _one_of(
            {"scan.laz": las(gps=np.arange(5) / 8.0), "scan.tum": b"-1 0 0 0 0 0 0 1\n5 10 0 -5 0 0 0 1\n"},
            "scan.tum",
            lambda folder: _read_bag(folder / "scan.laz"),
        ),
        **{f"{name} of a map": _one_of(finished, name, _read_map) for name in finished},
        "settings": Readable("survey.toml", _SETTINGS, _read_settings),
    }


def _one_of(files: Mapping[str, bytes], name: str, read: Callable[[Path], None]) -> Readable:
    """A file of a folder whose other files are undamaged."""

    def check(path: Path) -> None:
        for other, content in files.items():
            if other != name:
                (path.parent / other).write_bytes(content)
        read(path.parent)

    return Readable(name, files[name], check)


def _read_bag(folder: Path) -> None:
    read = read_scans([folder])
    assert all(np.isfinite(scan.points).all() for scan in read.scans)


def _read_map(folder: Path) -> None:
    for part in read_map_folder(folder).parts:
        assert np.isfinite(part.trajectory.T_world_sensor.as_matrix()).all()


def _read_settings(path: Path) -> None:
    try:
        read_settings(path, _VERBS.commands)
    except typer.BadParameter as error:  # a value that the option itself refuses
        raise InputError(f"{path}: {error}") from error


@cache
def _bag(compression: str) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        return _contents(write_ros2(Path(folder) / "dive", dive(), compression=compression))


@cache
def _map() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        files = _contents(finished_map(Path(folder) / "map"))
    return {name: files[name] for name in ("map.ply", "summary.json", "graph.json")}


def _contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.is_file()}
