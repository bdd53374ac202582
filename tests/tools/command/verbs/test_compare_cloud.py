"""`sonarmap compare` of a map and a point cloud of another program: end to end, and what is refused."""

from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import sonarmap as library
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.map_folder.folder import read_map_folder
from sonarmap.tools.files.writers.points import write_ply
from tests.samples.clutter_scans import T_WORLD_SENSOR, done, files_in, printed, refused, said, sonarmap
from tests.tools.command.verbs.test_compare import GRID, MAPPING, scans
from tests.tools.products.export.finished import finished_map

FAR = RigidTransform.from_translation([450_000.0, 6_651_000.0, 0.0])
OTHER = FAR * RigidTransform.from_exp_coords([0.0, 0.05, 0.7, 2.0, 5.0, 3.0])  # another program's frame


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A map on the Earth, and its points as LAZ."""
    root = tmp_path_factory.mktemp("placed")
    folder = finished_map(root / "map", georeference=Georeference(60.0, 9.0, height=-3.0))
    done(sonarmap("export", folder, "-o", root / "out", "--format", "laz"))
    return folder, root / "out" / "map.laz"


def test_a_cloud_on_the_earth(placed: tuple[Path, Path], tmp_path: Path) -> None:
    folder, cloud = placed
    result = done(sonarmap("compare", cloud, folder, "-o", tmp_path, "--same-frame"))
    said(result, "errors of the poses of", "are taken to count from 'surface'")
    assert "0 regions changed" in result.stdout
    assert {"changes.laz", "changes.tif"} <= set(files_in(tmp_path))
    ours, theirs = laspy.read(tmp_path / "changes.laz"), laspy.read(cloud)
    assert np.abs(ours.xyz.mean(axis=0) - theirs.xyz.mean(axis=0)).max() < 1
    back = printed(sonarmap("compare", folder, cloud, "-o", tmp_path, "--same-frame", "--json"))
    assert (back["new"], back["regions"], len(back["notes"])) == (str(cloud), [], 3)


def test_what_cannot_be_compared(placed: tuple[Path, Path], tmp_path: Path) -> None:
    folder, cloud = placed
    out = ("-o", tmp_path / "out")
    points = read_map_folder(folder).parts[0].points
    write_ply(tmp_path / "mm.ply", points * 1000)
    (tmp_path / "notes.doc").write_bytes(b"x")
    for given, words in (
        ((cloud, cloud), "both are point clouds"),
        ((folder, tmp_path / "mm.ply"), "are these millimeters"),
        ((folder, tmp_path / "missing.ply"), "cannot read"),
        ((folder, tmp_path / "notes.doc"), "nor a file of points"),
        ((folder, folder, "--cloud-sigma", "0.1"), "--cloud-sigma has no effect without"),
        ((folder, "--surveys", "--cloud-sigma", "0.1"), "--cloud-sigma has no effect with --surveys"),
        ((folder, cloud, "--cloud-sigma", "0"), "above 0"),
        ((cloud, folder, "--origin", "60,9"), "lies where its CRS says"),
    ):
        refused(sonarmap("compare", *given, *out), words)
    with pytest.raises(library.InputError, match="`old=5` cannot be used"):
        library.compare(5, folder)
    with pytest.raises(library.InputError, match="`cloud_sigma` has no effect without"):
        library.compare(folder, folder, cloud_sigma=0.1)


@pytest.mark.slow
def test_a_hole_is_found_from_either_side(tmp_path: Path) -> None:
    """All points of the later scans, and then of the earlier ones, where another program has them."""
    folders = {"old": scans(tmp_path / "a", 1, [0, 1, 2]), "new": scans(tmp_path / "b", 2, [1, 2, 3], dug=1.0)}
    poses, clouds, results = {"old": [0, 1, 2], "new": [1, 2, 3]}, dict[str, np.ndarray](), dict[str, Any]()
    for name, folder in folders.items():
        done(sonarmap("map", folder, "-o", tmp_path / name, *MAPPING))
        read = [library.read_scans(folder / f"scan_{k}.ply")[0].points for k in poses[name]]
        world = [T_WORLD_SENSOR[k].apply(points) for k, points in zip(poses[name], read, strict=True)]
        clouds[name] = OTHER.apply(np.concatenate(world))
        write_ply(tmp_path / f"{name}.ply", clouds[name])
    for old, new in (("old", "new.ply"), ("old.ply", "new")):
        given = (tmp_path / old, tmp_path / new, "-o", tmp_path / "out", *GRID)
        results[old] = printed(sonarmap("compare", *given, "--json"))
        (region,) = results[old]["regions"]
        assert region["kind"] == "lost"
        assert abs(region["volume_m3"] + 16) < 3 * region["volume_sigma_m3"]
    near = FAR.inv() * OTHER * T_WORLD_SENSOR[0]  # as the notes say
    off = results["old"]["alignment"]["T_old_new"] @ near.as_matrix()
    np.testing.assert_allclose(off, np.eye(4), atol=0.15)
    np.testing.assert_allclose(
        results["old.ply"]["regions"][0]["place_m"], near.apply(results["old"]["regions"][0]["place_m"]), atol=0.5
    )
    moved = library.compare(tmp_path / "old", OTHER.inv().apply(clouds["new"]), edge=64)
    assert moved.alignment is not None
    np.testing.assert_allclose(moved.alignment.T_old_new.as_matrix(), T_WORLD_SENSOR[0].inv().as_matrix(), atol=0.15)
