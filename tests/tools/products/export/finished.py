"""Map folders as `sonarmap map` writes them, and geodetic conversions independent of the code under test."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
from pyproj import Transformer
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.mapper import Mapper
from sonarmap.slam.survey_result import SurveyResult
from sonarmap.spectral.result import Registration
from sonarmap.tools.files.geo import Georeference, Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.products.export.clouds import Cloud
from sonarmap.tools.products.export.georeferenced import Georeferenced
from sonarmap.tools.products.output.folder import SurveyRun, write_survey
from tests.samples.surveys import KnowingRegistrar, ring_poses, scans_of

COUNT = 8
START = 1_483_228_790.25  # 2016-12-31T23:59:50.25Z: the leap second at the year's end is within the survey
STEP = 2.5
_A, _F = 6_378_137.0, 1 / 298.257223563  # WGS84's definition


def finished_map(out: Path, split: bool = False, georeference: Georeference | None = None) -> Path:
    """Write the map of a ring of scans, without pictures; with `split`, no pair joins the last three to the others."""
    inputs = [{"name": "scans/a.ply", "bytes": 3, "sha256": "0" * 64}]
    names = [f"scan{k}" for k in range(COUNT)]

    def empty_picture(path: Path, *_: object) -> None:
        path.write_bytes(b"")

    with patch("sonarmap.tools.products.output.folder.draw_map", empty_picture):
        write_survey(out, mapped(split), SurveyRun(names, {"voxel": 0.5}, inputs=inputs, georeference=georeference))
    return out


@cache
def mapped(split: bool) -> SurveyResult:
    """Survey of a ring of scans; with `split`, no pair joins the last three to the others."""
    truth = ring_poses(COUNT, radius=4.0)

    def spoil(i: int, j: int, given: Registration) -> Registration:
        apart = split and (i < COUNT - 3) != (j < COUNT - 3)
        return replace(given, accepted=False, reason="spoiled") if apart else given

    scans = [
        replace(scan, stamp=START + STEP * k, strength=np.linspace(0, 7, len(scan.points), dtype=np.float32))
        for k, scan in enumerate(scans_of(truth, reach=4.0))
    ]
    return Mapper(KnowingRegistrar(truth, 1e-4 * np.eye(6), spoil), 0.5).run(scans)


def local_of(projected: np.ndarray, epsg: int, here: Georeference) -> np.ndarray:
    """Points (N, 3) [m] in the map's frame from easting, northing, height: degrees by pyproj, then Earth-centered
    coordinates, rotated to East, North and Up at the origin; heights are relative to the origin's."""
    to_degrees = Transformer.from_crs(epsg, 4326, always_xy=True)
    longitude, latitude = to_degrees.transform(projected[:, 0], projected[:, 1])
    return local_of_degrees(np.column_stack([latitude, longitude, projected[:, 2]]), here)


def local_of_degrees(geodetic: np.ndarray, here: Georeference) -> np.ndarray:
    """Points (N, 3) [m] in the map's frame from latitude, longitude [deg] and height [m]."""
    away = _earth_centered(geodetic) - _earth_centered(np.array([[here.latitude, here.longitude, 0.0]]))
    phi, lam = np.radians([here.latitude, here.longitude])
    east = np.array([-np.sin(lam), np.cos(lam), 0])
    north = np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)])
    ahead = np.radians(here.heading)  # of x, clockwise from north; y is 90 degrees to its left
    x = np.sin(ahead) * east + np.cos(ahead) * north
    y = -np.cos(ahead) * east + np.sin(ahead) * north
    return np.column_stack([away @ x, away @ y, geodetic[:, 2] - here.height])


def _earth_centered(geodetic: np.ndarray) -> np.ndarray:
    phi, lam = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1])
    e2 = _F * (2 - _F)
    normal = _A / np.sqrt(1 - e2 * np.sin(phi) ** 2)
    flat = (normal + geodetic[:, 2]) * np.cos(phi)
    return np.column_stack([flat * np.cos(lam), flat * np.sin(lam), (normal * (1 - e2) + geodetic[:, 2]) * np.sin(phi)])


def scattered(count: int = 5, reach: float = 400.0, seed: int = 8) -> RigidTransform:
    """Random poses so far from the origin that a mere translation of the map would be meters off."""
    rng = np.random.default_rng(seed)
    return RigidTransform.from_translation(rng.uniform(-reach, reach, (count, 3)) * [1, 0.7, 0.02])


def timed(earth: Georeferenced, stamps: np.ndarray) -> Georeferenced:
    """The same map with other stamps [s]."""
    trajectory = replace(earth.part.trajectory, stamps=stamps)
    return replace(earth, part=replace(earth.part, trajectory=trajectory))


def cloud_of(earth: Georeferenced) -> Cloud:
    """Georeferenced cloud of the map's points."""
    return Cloud(earth.folder, earth.part, earth)


def georeferenced(here: Georeference, T_world_sensor: RigidTransform, points: int = 500) -> Georeferenced:
    """Georeferenced map of one part with these poses and random points around them."""
    rng = np.random.default_rng(3)
    count = len(T_world_sensor)
    middle = T_world_sensor.translation[rng.integers(0, count, points)]
    columns = {
        "count": rng.integers(1, 90, points).astype(np.int32),
        "seen": rng.integers(1, 9, points).astype(np.int32),
        "sigma": rng.uniform(0.01, 0.3, points).astype(np.float32),
        "scan": rng.integers(0, count, points).astype(np.int32),
        "survey": np.zeros(points, np.int32),
        "intensity": rng.uniform(0, 900, points).astype(np.float32),
    }
    part = MapPart(
        suffix="",
        points=middle + rng.uniform(-8, 8, (points, 3)),
        columns=columns,
        scans=tuple(range(count)),
        trajectory=Trajectory(1.7e9 + np.arange(count) * 2.5, T_world_sensor),
        covariances=np.tile(np.diag([1e-4, 2e-4, 3e-4, 0.01, 0.02, 0.03]), (count, 1, 1)),
        in_world=True,
    )
    folder = Map(Path("made-up"), tuple(f"scan_{k}" for k in range(count)), (part,), (), 0.2, {}, here, {})
    return Georeferenced(folder, part, here, Projection.of(here))
