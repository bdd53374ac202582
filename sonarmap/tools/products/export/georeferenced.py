"""A finished map on the Earth: the numbers that all export formats share, so that they agree."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.slam.map.surface import surface_reach
from sonarmap.tools.files.geo import EAST, Georeference, Projection
from sonarmap.tools.files.map_folder.folder import Map, MapPart
from sonarmap.tools.files.time_scales import are_times, utc_texts
from sonarmap.tools.products.export.grid import (
    Cells,
    DepthGrid,
    cells_of,
    check_size,
    empty_share,
    shown_heights,
    sufficient_cell,
)

# Sigma of an undetermined angle [deg]: a sensor that looks straight down has neither roll nor heading
_ANY_ANGLE = 180.0


@dataclass(frozen=True)  # without slots, for cached properties
class MapGrid:
    """One part of a map seen from above, in its own frame: the M points of its surface, and the cells of its grid."""

    folder: Map
    part: MapPart
    cell: float | None = field(default=None, kw_only=True)  # edge of a cell of grids and pictures [m]; None for a voxel
    height: str = field(default="top", kw_only=True)  # kind of a cell's height, a name of `formats.HEIGHTS`

    @cached_property
    def surface(self) -> MapPart:
        """The part reduced to the M points that lie on a surface."""
        return self.folder.surface(self.part)

    @cached_property
    def points(self) -> np.ndarray:
        """(M, 3) coordinates of the surface's points; the last is the height [m]."""
        return self.surface.points

    @cached_property
    def projected_points(self) -> np.ndarray:
        """(M, 3) x, y and height [m] of the surface's points, in the grid's coordinates."""
        return self.points

    @cached_property
    def shown_heights(self) -> tuple[float, float]:
        """Lower and upper end of the color scale [m]."""
        return shown_heights(self.points[:, 2], self.surface.columns["seen"])

    @property
    def cell_m(self) -> float:
        """Edge of a cell [m]."""
        return self.cell or self.folder.voxel

    @cached_property
    def depth_grid(self) -> DepthGrid:
        """The grid of the surface's points, north up in the grid's coordinates."""
        index = np.floor(self.projected_points[:, :2] / self.cell_m).astype(np.int64)
        left, top = int(index[:, 0].min()), int(index[:, 1].max()) + 1
        row, column = top - 1 - index[:, 1], index[:, 0] - left
        shape = int(row.max()) + 1, int(column.max()) + 1
        check_size(*shape, self.cell_m)
        return DepthGrid(self.cells(row, column), self.cell_m, top, left, shape)

    @cached_property
    def coverage(self) -> Mapping[str, float]:
        """`cell_m`, the `empty_share` of the covered cells, and `sufficient_cell_m`, for side-cars and notes."""
        places, reach = self.projected_points[:, :2], surface_reach(self.surface.points, self.folder.voxel)
        return {
            "cell_m": self.cell_m,
            "empty_share": empty_share(places, self.cell_m, reach),
            "sufficient_cell_m": sufficient_cell(places, self.cell_m, reach),
        }

    def cells(self, row: np.ndarray, column: np.ndarray, chosen: np.ndarray | slice = slice(None)) -> Cells:
        """The cells of a grid that has the surface's `chosen` points at row and column (M,) int64, not negative."""
        height, count = self.points[chosen, 2], self.surface.columns["count"][chosen]
        return cells_of(self.height, row, column, height, self.surface.height_sigma[chosen], count, self.folder.voxel)


@dataclass(frozen=True)  # without slots, for cached properties
class Georeferenced(MapGrid):
    """One part of a map on the Earth: its n scans, and the M points of its surface. Angles are those of the sensor, as
    in `readers.instruments`: roll positive starboard down, pitch positive nose up, heading clockwise from North."""

    georeference: Georeference  # of the part's frame
    projection: Projection  # the CRS of projected coordinates

    @cached_property
    def points(self) -> np.ndarray:
        """(M, 3) latitude, longitude [deg], height [m] of the surface's points."""
        return self.georeference.geodetic(self.surface.points)

    @cached_property
    def projected_points(self) -> np.ndarray:
        """(M, 3) easting, northing, height [m] of the surface's points."""
        return self.projection.project(self.points)

    @cached_property
    def poses(self) -> np.ndarray:
        """(n, 3) latitude, longitude [deg], height [m] of the scans' sensors."""
        return self.georeference.geodetic(self.part.trajectory.T_world_sensor.translation)

    @cached_property
    def projected_poses(self) -> np.ndarray:
        """(n, 3) easting, northing, height [m] of the scans' sensors."""
        return self.projection.project(self.poses)

    @cached_property
    def rotations(self) -> Rotation:
        """R_enu_sensor of the n scans, with East-North-Up at each scan's position, as meridians converge."""
        R_enu_map = Rotation.from_euler("z", EAST - self.georeference.heading, degrees=True)
        latitude, longitude, _ = self.poses.T
        difference = (longitude - self.georeference.longitude + 180) % 360 - 180
        # The Earth's curvature also tilts the frame, by 1e-5 rad in 100 m; this is neglected, as the map's z follows it
        middle = np.radians((latitude + self.georeference.latitude) / 2)
        convergence = Rotation.from_euler("z", -(difference * np.sin(middle))[:, None], degrees=True)
        R: Rotation = convergence * R_enu_map * self.part.trajectory.T_world_sensor.rotation
        return R

    @property
    def names(self) -> list[str]:
        """Names of the n scans."""
        return [self.folder.names[scan] for scan in self.part.scans]

    @property
    def stamps(self) -> np.ndarray:
        """(n,) stamps of the scans [s]."""
        return self.part.trajectory.stamps

    @property
    def in_time(self) -> list[int]:
        return np.argsort(self.stamps, kind="stable").tolist()

    @property
    def timed(self) -> bool:
        return are_times(self.stamps)

    @cached_property
    def utc(self) -> Sequence[str]:
        """Times of the n scans, ISO 8601; empty where they are not known."""
        return utc_texts(self.stamps)

    @cached_property
    def surveys(self) -> list[int]:
        """Survey of each scan."""
        return self.folder.surveys(self.part)

    @property
    def lines(self) -> list[np.ndarray]:
        """Track of each survey with two or more scans, as indices of its scans."""
        surveys = np.asarray(self.surveys)
        chosen = (np.flatnonzero(surveys == number) for number in np.unique(surveys))
        return [indices for indices in chosen if len(indices) > 1]

    @cached_property
    def attitudes(self) -> np.ndarray:
        """(n, 3) roll, pitch, true heading [deg]; the heading in [0, 360)."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Gimbal lock")  # looking straight down: a valid set of angles is chosen
            yaw, pitch, roll = self.rotations.as_euler("ZYX", degrees=True).T
        return np.column_stack([roll, -pitch, (90.0 - yaw) % 360.0])

    @cached_property
    def convergences(self) -> np.ndarray:
        """(n,) meridian convergence [deg]: true heading less grid heading."""
        return self.projection.convergence(self.poses)

    @property
    def grid_headings(self) -> np.ndarray:
        """(n,) headings from grid North [deg], in [0, 360)."""
        return (self.attitudes[:, 2] - self.convergences) % 360.0

    @cached_property
    def covariances(self) -> np.ndarray:
        """(n, 6, 6) covariances of shift along [m] and rotation about [rad] East, North, Up, at the sensor."""
        to_enu = np.zeros_like(self.part.covariances)
        to_enu[:, :3, 3:] = to_enu[:, 3:, :3] = self.rotations.as_matrix()
        return to_enu @ self.part.covariances @ to_enu.mT

    @cached_property
    def sigmas(self) -> np.ndarray:
        """(n, 6) standard deviations of East, North, Up [m], roll, pitch, heading [deg], at most 180."""
        roll, pitch = np.radians(self.attitudes[:, 0]), -np.radians(self.attitudes[:, 1])
        # derivatives of the angles of Rz(yaw) Ry(pitch) Rx(roll) by small rotations about the sensor's axes
        J = np.zeros((len(roll), 3, 3))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            J[:, 0] = np.column_stack([np.ones_like(roll), np.sin(roll) * np.tan(pitch), np.cos(roll) * np.tan(pitch)])
            J[:, 1] = np.column_stack([np.zeros_like(roll), np.cos(roll), -np.sin(roll)])
            J[:, 2] = np.column_stack([np.zeros_like(roll), np.sin(roll), np.cos(roll)]) / np.cos(pitch)[:, None]
            turns = np.diagonal(J @ self.part.covariances[:, :3, :3] @ J.mT, axis1=1, axis2=2)
            shifts = np.diagonal(self.covariances[:, :3, :3], axis1=1, axis2=2)
            angles = np.minimum(np.degrees(np.sqrt(np.maximum(turns, 0.0))), _ANY_ANGLE)
        return np.hstack([np.sqrt(np.maximum(shifts, 0.0)), angles])
