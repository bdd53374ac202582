"""Clouds in CloudCompare itself, and by PCL, which is what its plugin reads PCD with."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.writers.points import write_points
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.export.laz import write_laz
from tests.tools.products.export.finished import scattered
from tests.tools.products.export.folders import georeferenced

OPTIONS = ("-C_EXPORT_FMT", "ASC", "-PREC", "6", "-ADD_HEADER", "-NO_TIMESTAMP", "-SAVE_CLOUDS")


def made_up() -> Georeferenced:
    return georeferenced(Georeference(60.3913, 5.3221, height=-4.5), scattered())


def in_cloudcompare(path: Path) -> tuple[list[str], np.ndarray]:
    """Names of the columns that CloudCompare saves again of a cloud, and their numbers (N, k)."""
    command = shutil.which("CloudCompare")
    if command is None:
        pytest.skip("CloudCompare is not installed (Debian: cloudcompare)")
    surroundings = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "HOME": str(path.parent)}
    asked = [command, "-SILENT", "-O", "-GLOBAL_SHIFT", "AUTO", str(path), *OPTIONS]
    said = subprocess.run(asked, capture_output=True, text=True, env=surroundings, check=False)
    if "unhandled file extension" in said.stdout + said.stderr:
        pytest.skip(f"this CloudCompare was built without a reader of {path.suffix}")
    saved = path.with_suffix(".asc")
    assert saved.exists(), said.stdout + said.stderr
    names = saved.read_text().splitlines()[0].removeprefix("//").split()
    return names, np.loadtxt(saved, skiprows=1)


def named(names: list[str], table: np.ndarray, name: str) -> np.ndarray:
    """A column by its name, in any case; CloudCompare of some versions puts words before or after it."""
    (index,) = (k for k, each in enumerate(names) if name in each.lower())
    return table[:, index]


@pytest.mark.parametrize(
    ("kind", "columns"), [("ply", ("intensity",)), ("pcd", ("sigma",)), ("laz", ("sigma", "seen"))]
)
def test_clouds(tmp_path: Path, kind: str, columns: tuple[str, ...]) -> None:
    """Of a PLY, coordinates and strengths come by themselves; the others are chosen in CloudCompare's dialog."""
    earth, path = made_up(), tmp_path / f"map.{kind}"
    if kind == "laz":
        write_laz(path, earth)
    else:
        write_points(path, earth.part.points, earth.part.columns)
    names, table = in_cloudcompare(path)
    expected = earth.projected_points if kind == "laz" else earth.part.points
    np.testing.assert_allclose(table[:, :3], expected, rtol=0, atol=1e-3)
    for name in columns:
        np.testing.assert_allclose(named(names, table, name), earth.part.columns[name], rtol=1e-5, atol=1e-5)


def test_pcl_reads_every_field(tmp_path: Path) -> None:
    command = shutil.which("pcl_convert_pcd_ascii_binary")
    if command is None:
        pytest.skip("PCL's programs are not installed (Debian: pcl-tools)")
    part = made_up().part
    write_points(tmp_path / "map.pcd", part.points, part.columns)
    subprocess.run([command, tmp_path / "map.pcd", tmp_path / "text.pcd", "0"], capture_output=True, check=True)
    lines = (tmp_path / "text.pcd").read_text().splitlines()
    (fields,) = (line.split()[1:] for line in lines if line.startswith("FIELDS"))
    table = np.loadtxt(lines[lines.index("DATA ascii") + 1 :])
    assert sorted(fields) == sorted(["x", "y", "z", *part.columns])
    np.testing.assert_allclose(table[:, :3], part.points, rtol=0, atol=1e-3)
    for name, column in part.columns.items():
        np.testing.assert_allclose(table[:, fields.index(name)], column, rtol=1e-6, atol=1e-9)
