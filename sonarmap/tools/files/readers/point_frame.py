"""How the points of files are given, along which axes and in which unit: turned and scaled once, when they are read."""

from dataclasses import dataclass, replace

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.readers.clouds.cloud import Cloud

# Axes of the points as a file has them -> rows of R_flu_file: forward, left and up in the file's axes.
FRAMES = {
    "flu": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),  # x forward, y left, z up
    "frd": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),  # x forward, y right, z down
    "rdf": ((0, 0, 1), (-1, 0, 0), (0, -1, 0)),  # x right, y down, z forward, as of cameras
    "ned": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),  # x North, y East, z down: scans that were leveled and turned North
}
# Name -> meters. The US survey foot is 1200/3937 m.
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200 / 3937}


@dataclass(frozen=True, slots=True)
class PointFrame:
    """The axes and the unit of the points in files.

    Attributes:
        axes: a name of FRAMES. The points of "ned" become East-North-Up, of the others forward-left-up.
        unit: a name of UNITS.

    Raises InputError: another name.
    """

    axes: str = "flu"
    unit: str = "m"

    def __post_init__(self) -> None:
        for given, known in ((self.axes, FRAMES), (self.unit, UNITS)):
            if given not in known:
                raise InputError(f"{given!r} is not known; choose one of {', '.join(known)}")

    @property
    def is_default(self) -> bool:
        """Whether points stay as they are."""
        return self == PointFrame()

    def turned(self, cloud: Cloud) -> Cloud:
        """The cloud with points and viewpoints in meters, x forward, y left, z up."""
        if self.is_default:
            return cloud
        viewpoints = None if cloud.viewpoints is None else self._turned(cloud.viewpoints)
        return replace(cloud, points=self._turned(cloud.points), viewpoints=viewpoints)

    def _turned(self, points: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite are dropped later
            # axis by axis: a product would spread NaN over the others
            return np.stack([self._axis(points, row) for row in FRAMES[self.axes]], axis=1)

    def _axis(self, points: np.ndarray, row: tuple[int, int, int]) -> np.ndarray:
        (axis,) = np.flatnonzero(row).tolist()
        return points[:, axis].astype(np.float64) * (row[axis] * UNITS[self.unit])


AS_WE_HAVE_THEM = PointFrame()
