# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Poses on the Earth in the words of navigation: positions, attitudes as displays show them, and their errors.

Signs as in `readers.instruments`: roll positive starboard down, pitch positive nose up, heading clockwise from
North, all of the sensor's axes.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.map_folder.names import SUMMARY
from sonarmap.tools.files.time_scales import are_times, utc_texts
from sonarmap.tools.products.export.georeferenced import Georeferenced

# A standard deviation that says nothing of the angle: a sensor that looks straight down has neither roll nor heading
_ANY_ANGLE = 180.0


@dataclass(frozen=True, slots=True)
class Navigation:
    """What n scans say of where the sensor was.

    Attributes:
        names: of the scans.
        scans: their numbers in the survey.
        surveys: to which survey each belongs.
        stamps: (n,) [s].
        timed: whether the stamps are Unix seconds.
        utc: the times, ISO 8601; empty text where they are not known.
        geodetic: (n, 3) latitude, longitude [deg], WGS84, height above the vertical reference [m].
        projected: (n, 3) easting, northing, height [m].
        attitudes: (n, 3) roll, pitch, true heading [deg]; the heading in [0, 360).
        convergences: (n,) [deg]: the true heading less the grid heading.
        grid_headings: (n,) from grid North [deg], in [0, 360).
        covariances: (n, 6, 6) of the errors East, North, Up [m] and of a turn about East, North, Up [rad], at the
            sensor.
        sigmas: (n, 6) standard deviations of East, North, Up [m], roll, pitch, heading [deg], at most 180.
        vertical: what heights count from.
    """

    names: Sequence[str]
    scans: Sequence[int]
    surveys: Sequence[int]
    stamps: np.ndarray
    timed: bool
    utc: Sequence[str]
    geodetic: np.ndarray
    projected: np.ndarray
    attitudes: np.ndarray
    convergences: np.ndarray
    grid_headings: np.ndarray
    covariances: np.ndarray
    sigmas: np.ndarray
    vertical: str

    @classmethod
    def of(cls, earth: Georeferenced) -> "Navigation":
        """The navigation of one part of a map."""
        part, names = earth.part, earth.folder.names
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Gimbal lock")  # straight down; the three angles are right together
            yaw, pitch, roll = earth.rotations.as_euler("ZYX", degrees=True).T
        attitudes = np.column_stack([roll, -pitch, (90.0 - yaw) % 360.0])
        convergences = earth.projection.convergence(earth.poses)
        covariances = _at_sensor(part.covariances, earth.rotations.as_matrix())
        stamps = part.trajectory.stamps
        return cls(
            names=[names[scan] for scan in part.scans],
            scans=part.scans,
            surveys=_surveys(earth),
            stamps=stamps,
            timed=are_times(stamps),
            utc=utc_texts(stamps),
            geodetic=earth.poses,
            projected=earth.projected_poses,
            attitudes=attitudes,
            convergences=convergences,
            grid_headings=(attitudes[:, 2] - convergences) % 360.0,
            covariances=covariances,
            sigmas=_sigmas(part.covariances, covariances, attitudes),
            vertical=earth.georeference.vertical,
        )

    @property
    def lines(self) -> list[np.ndarray]:
        """The track as lines: indices of the scans of each survey, where it has two or more."""
        surveys = np.asarray(self.surveys)
        chosen = (np.flatnonzero(surveys == number) for number in np.unique(surveys))
        return [indices for indices in chosen if len(indices) > 1]


def _surveys(earth: Georeferenced) -> list[int]:
    """To which survey each scan belongs; all to the first where the summary does not say."""
    rows = earth.folder.summary.get("scans")
    if not rows:
        return [0] * len(earth.part.scans)
    try:
        return [int(rows[scan]["survey"]) for scan in earth.part.scans]
    except (LookupError, TypeError, ValueError) as error:
        where = earth.folder.path / SUMMARY
        raise InputError(f"{where} does not say of which survey its scans are; map again") from error


def _at_sensor(covariances: np.ndarray, R_enu_sensor: np.ndarray) -> np.ndarray:
    """(n, 6, 6) body tangents, rotation first, as translation first along East, North and Up."""
    to_enu = np.zeros_like(covariances)
    to_enu[:, :3, 3:] = R_enu_sensor
    to_enu[:, 3:, :3] = R_enu_sensor
    return to_enu @ covariances @ to_enu.mT


def _sigmas(body: np.ndarray, at_sensor: np.ndarray, attitudes: np.ndarray) -> np.ndarray:
    """(n, 6) of East, North, Up [m], roll, pitch, heading [deg]; `body` and `at_sensor` are (n, 6, 6)."""
    roll, pitch = np.radians(attitudes[:, 0]), -np.radians(attitudes[:, 1])
    # What small turns about the sensor's axes do to the angles of Rz(yaw) Ry(pitch) Rx(roll)
    J = np.zeros((len(body), 3, 3))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        J[:, 0] = np.column_stack([np.ones_like(roll), np.sin(roll) * np.tan(pitch), np.cos(roll) * np.tan(pitch)])
        J[:, 1] = np.column_stack([np.zeros_like(roll), np.cos(roll), -np.sin(roll)])
        J[:, 2] = np.column_stack([np.zeros_like(roll), np.sin(roll), np.cos(roll)]) / np.cos(pitch)[:, None]
        turns = np.diagonal(J @ body[:, :3, :3] @ J.mT, axis1=1, axis2=2)
        shifts = np.diagonal(at_sensor[:, :3, :3], axis1=1, axis2=2)
        angles = np.minimum(np.degrees(np.sqrt(np.maximum(turns, 0.0))), _ANY_ANGLE)
    return np.hstack([np.sqrt(np.maximum(shifts, 0.0)), angles])
