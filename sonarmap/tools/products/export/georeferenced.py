# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false
"""A finished map with its places on the Earth: the numbers that all formats share, so that they agree."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.tools.files.geo.georeference import EAST, Georeference
from sonarmap.tools.files.geo.projection import Projection
from sonarmap.tools.files.map_folder.folder import MapFolder, MapPart


@dataclass(frozen=True)  # without slots: what is computed is kept
class Georeferenced:
    """One part of a map whose place on the Earth is known.

    Attributes:
        folder: the map.
        part: of it.
        georeference: of the part's frame.
        projection: the CRS of projected coordinates.
        cell: edge of a cell of grids and pictures [m]; None for the map's voxel.
    """

    folder: MapFolder
    part: MapPart
    georeference: Georeference
    projection: Projection
    cell: float | None = None

    @cached_property
    def points(self) -> np.ndarray:
        """(M, 3) latitude, longitude [deg], height [m] of the map's points."""
        return self.georeference.geodetic(self.part.points)

    @cached_property
    def projected_points(self) -> np.ndarray:
        """(M, 3) easting, northing, height [m] of the map's points."""
        return self.projection.project(self.points)

    @cached_property
    def poses(self) -> np.ndarray:
        """(n, 3) latitude, longitude [deg], height [m] of the scans."""
        return self.georeference.geodetic(self.part.trajectory.T_world_sensor.translation)

    @cached_property
    def projected_poses(self) -> np.ndarray:
        """(n, 3) easting, northing, height [m] of the scans."""
        return self.projection.project(self.poses)

    @cached_property
    def rotations(self) -> Rotation:
        """R_enu_sensor of the n scans, East-North-Up at each scan's own place: meridians converge."""
        to_east = Rotation.from_euler("z", EAST - self.georeference.heading, degrees=True)
        latitude, longitude, _ = self.poses.T
        apart = (longitude - self.georeference.longitude + 180) % 360 - 180
        # North turns against the map's by the meridians' convergence; what else the Earth's curvature tilts (1e-5 rad
        # in 100 m) is left out, as the map's z follows it
        middle = np.radians((latitude + self.georeference.latitude) / 2)
        turned = Rotation.from_euler("z", -(apart * np.sin(middle))[:, None], degrees=True)
        R: Rotation = turned * to_east * self.part.trajectory.T_world_sensor.rotation
        return R
