"""Navigation in recordings: poses and dead reckoning, orientations and turn rates of an IMU, fixes, and pressures.

Axes, frames and the order of covariances are those of REP-103, REP-105 and REP-145: the world is East-North-Up, unless
a frame's name ends with _ned; the rotations' covariances are those of roll, pitch and yaw. What a sensor measures is
moved to base_link if tf_static has its mounting.
"""

import warnings
from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from sonarmap.kernels.errors import InputError
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.bags.frames import DOWN, Frames, are_rigid, rigid
from sonarmap.tools.files.readers.bags.open import open_recording
from sonarmap.tools.files.readers.bags.recording import Recording, Topic, choose_topic, listed
from sonarmap.tools.files.readers.bags.series import (
    ABSOLUTE,
    FIELDS,
    FIX,
    GRAVITY,
    IMU,
    ODOMETRY,
    POSE,
    PRESSURE,
    Series,
    series_of,
)
from sonarmap.tools.files.readers.instruments import COLUMNS, LEAST_SIGMA, PRIOR_SIGMAS, poses_of, values_of
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.settings import (
    DOWN_FRAMES,
    OF_NMEA,
    OF_TABLES,
    UNKNOWN_TILT,
    NavigationSettings,
    local_places,
)
from sonarmap.tools.files.user_file import naming

_UNUSED = tuple(set(OF_TABLES + OF_NMEA) - {"--nav-frame", "--magnetic-declination"})
_NAMED = 3  # faults that are listed
_R_ENU_NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
_AIR, _SEA_WATER = 101_325.0, 1025.0  # [Pa], [kg/m^3]
_PRESSURES = (6e4, 1.2e8)  # possible absolute pressures, from a mountain lake to the deepest sea [Pa]
_AROUND = 0.5  # [s], before and after a scan, in which accelerations are averaged
_UNMEASURED = np.array([180.0] * 3 + [1e4] * 3)  # [deg, m]: drivers write such deviations for what is not measured


def recorded_turn_rates(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Ascending times (n,) [s, UTC] and turn rates (n, 3) [rad/s] of the sensor_msgs/Imu topic with the most messages,
    about the axes of base_link if tf_static has the IMU's mounting, otherwise of its own frame (x forward, y left, z
    up)."""
    with naming(path):
        recording = open_recording(path)
        topics = recording.of_kinds((IMU,))
        if not topics:
            raise InputError(f"it has no messages of type {IMU}")
        series = series_of(recording, max(topics, key=lambda topic: topic.count), [])
        rates = series.numbers[:, 13:16]
        known = np.isfinite(rates).all(axis=1)
        if not known.any():
            raise InputError(f"none of its messages of type {IMU} can be read")
        return series.times[known], Frames(recording).T_base(series.frame).rotation.apply(rates[known])


def read_recorded_navigation(
    path: Path,
    topic: str | None,
    settings: NavigationSettings,
    sigmas: Mapping[str, float] | None,
    scans: np.ndarray,
    notes: list[str],
) -> NavigationLog:
    """The measurements in a recording, of base_link if tf_static has the sensors' mounting. Without a `topic` they are
    all but odometry, which drifts, or odometry alone if no `sigmas` are needed. Other arguments as of
    `readers.navigation.overview.read_navigation`."""
    settings.refuse_unused(path, "is a recording", _UNUSED)
    found = list[str]()
    with naming(path):
        recording = open_recording(path)
        reader = _Reader(recording, settings, scans, found)
        parts = [reader.rows_of(each) for each in _chosen(recording, topic, path, sigmas is None)]
        times, rows = np.unique(np.concatenate([part[0] for part in parts]), return_inverse=True)
        values, deviations = np.full((2, len(times), 6), np.nan)
        measured = np.concatenate([part[1] for part in parts]), np.concatenate([part[2] for part in parts])
        row, column = np.nonzero(np.isfinite(measured[0]))  # a column is measured once at a time
        values[rows[row], column], deviations[rows[row], column] = (each[row, column] for each in measured)
        if sigmas is not None:
            values[deviations >= _UNMEASURED] = np.nan
            values += 0 * values[:, [1, 0, 2, 4, 3, 5]]  # roll counts with pitch alone, and East with North
        bare = (np.isfinite(values) & np.isnan(deviations)).any(axis=0)
        missing = [name for name in np.array(COLUMNS)[bare].tolist() if sigmas is not None and name not in sigmas]
        if missing:
            raise InputError(f"{missing[0]} has no covariance in some messages; give {PRIOR_SIGMAS}")
    notes += [f"{path}: {note}" for note in dict.fromkeys(found)]
    keys, lines = tuple(f"{time:.3f}" for time in times.tolist()), np.arange(1, len(times) + 1)
    return NavigationLog("stamp", lines, keys, times, values, deviations, reader.georeference)


def _chosen(recording: Recording, name: str | None, path: Path, reckoned: bool) -> list[Topic]:
    """The topic called `name`; without one the topics of all kinds that measure the pose in the world, or, with
    `reckoned`, the only one of dead reckoning."""
    topics, odometry = recording.of_kinds(ABSOLUTE), recording.of_kinds((ODOMETRY,))
    if name is None and odometry and not (topics or reckoned):
        raise InputError(
            f"it has dead reckoning alone, which drifts: use --odometry {path}; if it is corrected, as by a fix, name "
            f"it, as in --priors {path}::{odometry[0].name}"
        )
    if name is not None or reckoned or not topics:
        kinds = tuple(FIELDS) if name is not None or not reckoned else (ODOMETRY,) if odometry else (POSE,)
        return [choose_topic(recording, name, kinds, path)]
    kinds = {topic.kind for topic in topics}
    if len(kinds) < len(topics) or (POSE in kinds and len(kinds) > 1):
        raise InputError(
            f"several of its topics measure the same: {listed(topics)}; choose, as in --priors {path}::{topics[0].name}"
            f" --priors {path}::{topics[1].name}"
        )
    return topics


_Rows = tuple[np.ndarray, np.ndarray, np.ndarray]  # times (n,); values and standard deviations (n, 6), as in a log


class _Reader:
    """Reads topics as rows of a log. `georeference` is that of fixes, once they are read."""

    def __init__(self, recording: Recording, settings: NavigationSettings, scans: np.ndarray, notes: list[str]) -> None:
        self._recording, self._settings, self._scans, self._notes = recording, settings, scans, notes
        self._frames = Frames(recording)
        self.georeference: Georeference | None = None

    def rows_of(self, topic: Topic) -> _Rows:
        faults: list[str] = []
        series = series_of(self._recording, topic, faults)
        self._notes += faults[:_NAMED]
        of_kind = {FIX: self._of_fixes, IMU: self._of_imu, PRESSURE: self._of_pressures}
        return of_kind.get(topic.kind, self._of_poses)(series)

    def _kept(self, series: Series, usable: np.ndarray, lacking: str) -> np.ndarray:
        """The indices of the usable messages; a note tells how many others lack something."""
        count = int((~usable).sum())
        if count == len(usable):
            raise InputError(f"all {count:,} messages of {series.topic} are {lacking}")
        if count:
            self._notes.append(f"{count:,} of {len(usable):,} messages of {series.topic} are left out: {lacking}")
        return np.flatnonzero(usable)

    def _of_poses(self, series: Series, down: bool = False) -> _Rows:
        """Rows of poses. `down`: whether the world is North-East-Down, and a frame that tf_static lacks has z down."""
        down = down or self._settings.frame in DOWN_FRAMES
        kept = self._kept(series, are_rigid(series.numbers[:, :7]), "without a unit quaternion")
        covariances = series.numbers[kept, 7:43].reshape(-1, 6, 6)
        T_base_child = self._frames.T_base(series.child)
        if down and np.array_equal(T_base_child.as_matrix(), np.eye(4)):
            T_base_child = RigidTransform.from_rotation(DOWN)
        R_enu = _R_ENU_NED if down or series.frame.endswith("_ned") else Rotation.identity()
        T_world_child = rigid(series.numbers[kept, :7], series.topic)
        poses = RigidTransform.from_rotation(R_enu) * T_world_child * T_base_child.inv()
        turned = partial(np.einsum, "ij,njk,ik->ni")  # variances of turned covariances
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # of SciPy: heading and roll are ambiguous at a pitch of 90 degrees
            values = values_of(poses)
            R_base, R = T_base_child.rotation.as_matrix(), R_enu.as_matrix()
            of_angles = turned(R_base, covariances[:, 3:, 3:], R_base)
            of_places = turned(R, covariances[:, :3, :3], R)
        if self._settings.declination is not None:
            values[:, 2] = (values[:, 2] + self._settings.declination) % 360
        return series.times[kept], values, np.hstack([np.degrees(_sigmas(of_angles)), _sigmas(of_places)])

    def _of_imu(self, series: Series) -> _Rows:
        """Rows of orientations, or of gravity at the scans' times if there are none."""
        poses = np.zeros((len(series.times), 43))
        poses[:, 3:7] = series.numbers[:, :4] * (series.numbers[:, 4:5] != -1)  # by REP-145, -1 if there is none
        poses[:, 7:].reshape(-1, 6, 6)[:, 3:, 3:] = series.numbers[:, 4:13].reshape(-1, 3, 3)
        known = are_rigid(poses[:, :7])
        if not known.any():
            return self._of_gravity(series)
        forces = np.clip(np.nan_to_num(series.numbers[known, 16:]), -10 * GRAVITY, 10 * GRAVITY)
        down = bool(Rotation.from_quat(poses[known, 3:7]).apply(forces).mean(axis=0)[2] < -GRAVITY / 2)
        if down:
            self._notes.append(f"the world of {series.topic} is North-East-Down, as its accelerations show")
        oriented = Series(series.topic, series.times, poses, series.frame, series.child)
        times, values, deviations = self._of_poses(oriented, down)
        if self._settings.declination is None:
            self._notes.append(
                f"the headings of {series.topic} are taken as from true North; if its compass is magnetic, give "
                "--magnetic-declination DEG"
            )
        values[:, 3:] = np.nan
        return times, values, deviations

    def _of_gravity(self, series: Series) -> _Rows:
        from sonarmap.tools.files.readers.sonar.recording import ImuSamples, attitude_at  # imports an HTTP client

        R_base, motion = self._frames.T_base(series.child).rotation, series.numbers[:, 13:]
        kept = self._kept(series, np.isfinite(np.abs(motion).max(axis=1)), "without an orientation and accelerations")
        times, rates, forces = series.times[kept], R_base.apply(motion[kept, :3]), R_base.apply(motion[kept, 3:])
        rows = list[tuple[float, np.ndarray, np.ndarray]]()
        for stamp in (self._scans if len(self._scans) else times[:: len(times) // 1000 + 1]).tolist():
            around = slice(*np.searchsorted(times, [stamp - _AROUND, stamp + _AROUND]))
            if prior := attitude_at(stamp, ImuSamples(times[around], forces[around], rates[around])):
                rows.append((stamp, values_of(prior.T_world_sensor), np.degrees(prior.sigmas)))
        if not rows:
            raise InputError(f"{series.topic} has no orientation, and its accelerations give none at the scans' times")
        self._notes.append(f"{series.topic} has no orientation: roll and pitch are those of its accelerations")
        stamps, values, deviations = (np.array(column) for column in zip(*rows, strict=True))
        values[:, 2:] = np.nan
        return stamps, values, deviations

    def _of_fixes(self, series: Series) -> _Rows:
        longitude, latitude, status, known = series.numbers[:, :4].T
        usable = (status >= 0) & (np.abs(longitude) <= 180) & (np.abs(latitude) <= 90)
        kept = self._kept(series, usable, "without a fix")
        values, deviations = np.full((2, len(kept), 6), np.nan)
        values[:, 3], values[:, 4] = longitude[kept], latitude[kept]
        covariances = np.where(known[kept, None] > 0, series.numbers[kept, 4:], np.nan)
        deviations[:, 3:5] = _sigmas(covariances[:, [0, 4]])  # East, North
        values, self.georeference = local_places(values, True, self._settings, self._notes)
        return self._of_base(series.frame, series.times[kept], values, deviations)

    def _of_pressures(self, series: Series) -> _Rows:
        pressures, variances = series.numbers.T
        low, high = _PRESSURES
        lacking = f"not between {low:,.0f} and {high:,.0f} Pa; wanted absolute pressures in pascal"
        kept = self._kept(series, (pressures >= low) & (pressures <= high), lacking)
        values, deviations = np.full((2, len(kept), 6), np.nan)
        values[:, 5] = (pressures[kept] - _AIR) / (_SEA_WATER * GRAVITY)
        deviations[:, 5] = _sigmas(variances[kept]) / (_SEA_WATER * GRAVITY)
        self._notes.append(
            f"depths are the pressures of {series.topic} above {_AIR:,.0f} Pa in salt water of {_SEA_WATER:,.0f} kg/m3;"
            " in fresh water they are 2.5 % larger"
        )
        return self._of_base(series.frame, series.times[kept], values, deviations)

    def _of_base(self, frame: str, times: np.ndarray, values: np.ndarray, deviations: np.ndarray) -> _Rows:
        """Rows of base_link from those of a sensor beside it. If the attitude is not known, the lever arm is level, and
        its length is an error of the position."""
        lever = self._frames.T_base(frame).translation
        if not lever.any():
            return times, values, deviations
        if (attitude := self._attitude) is not None:
            lever = attitude(np.clip(times, attitude.times[0], attitude.times[-1])).apply(lever)
        else:
            flat = float(np.hypot(lever[0], lever[1]))
            deviations[:, 3:] = np.hypot(deviations[:, 3:], [flat, flat, UNKNOWN_TILT * flat])
            lever = lever * [0, 0, 1]
        values[:, 3:] -= lever * [1.0, 1.0, -1.0]
        return times, values, deviations

    @cached_property
    def _attitude(self) -> Slerp | None:
        """The vehicle's attitude by the only IMU, if that has headings."""
        topics = self._recording.of_kinds((IMU,))
        if len(topics) != 1:
            return None
        with suppress(InputError):  # it has no orientation
            times, values, _ = self._of_imu(series_of(self._recording, topics[0], []))
            if len(times) > 1 and not np.isnan(values[:, 2]).any():
                return Slerp(times, poses_of(np.nan_to_num(values)).rotation)
        return None


def _sigmas(variances: np.ndarray) -> np.ndarray:
    """Standard deviations; NaN for variances that are not above 0, which messages have where they are unknown."""
    return np.sqrt(np.where(variances > LEAST_SIGMA**2, variances, np.nan))
