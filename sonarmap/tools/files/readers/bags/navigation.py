"""Navigation in recordings: poses and dead reckoning, orientations and turn rates of an IMU, fixes, and pressures.

Axes, frames and the order of covariances are those of REP-103, REP-105 and REP-145: the world is East-North-Up, unless
a frame's name ends with _ned; the rotations' covariances are those of roll, pitch and yaw. What a sensor measures is
moved to base_link if tf_static has its mounting.
"""

import warnings
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation, Slerp

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.files.geo import Georeference
from sonarmap.tools.files.readers.bags.frames import BASE, DOWN, Frames, are_rigid, numbers_of, rigid, stamp_of
from sonarmap.tools.files.readers.bags.open import open_recording
from sonarmap.tools.files.readers.bags.recording import Recording, Topic, choose_topic, decode, listed, refused
from sonarmap.tools.files.readers.instruments import COLUMNS, LEAST_SIGMA, PRIOR_SIGMAS, poses_of, values_of
from sonarmap.tools.files.readers.navigation.log import NavigationLog
from sonarmap.tools.files.readers.navigation.settings import (
    DOWN_FRAMES,
    OF_NMEA,
    OF_TABLES,
    NavigationSettings,
    local_places,
)
from sonarmap.tools.files.user_file import naming

ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
IMU = "sensor_msgs/msg/Imu"
FIX = "sensor_msgs/msg/NavSatFix"
PRESSURE = "sensor_msgs/msg/FluidPressure"
_ABSOLUTE = (POSE, FIX, IMU, PRESSURE)  # kinds that measure the pose in the world
_UNUSED = tuple(set(OF_TABLES + OF_NMEA) - {"--nav-frame", "--magnetic-declination"})
_NAMED = 3  # faults that are listed
_R_ENU_NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
_AIR, _SEA_WATER, _GRAVITY = 101_325.0, 1025.0, 9.80665  # [Pa], [kg/m^3], [m/s^2]
_ACCELERATION = 1.0  # [m/s^2], by which the mean specific force may differ from gravity
_PRESSURES = (6e4, 1.2e8)  # absolute pressures that are possible, from a mountain lake to the deepest sea [Pa]
_UNMEASURED = np.array([180.0] * 3 + [1e4] * 3)  # [deg, m]: drivers write such deviations for what is not measured
_UNKNOWN_TILT = 0.2  # [rad], standard deviation of a tilt that was not measured


@dataclass(frozen=True, slots=True)
class _Series:
    """The messages of a topic in the order of their stamps."""

    topic: str
    times: np.ndarray  # (n,) float64 [s, UTC], without duplicates
    numbers: np.ndarray  # (n, m) float64, by the kind's function of _NUMBERS
    frame: str  # in the header of the last message
    child: str  # the moving frame


def _numbers_of_pose(content: Any) -> tuple[float, ...]:
    pose = content.pose.pose
    return *numbers_of(pose.position, pose.orientation), *content.pose.covariance


def _numbers_of_imu(content: Any) -> tuple[float, ...]:
    turn, force, rate = content.orientation, content.linear_acceleration, content.angular_velocity
    motion = force.x, force.y, force.z, rate.x, rate.y, rate.z
    return 0.0, 0.0, 0.0, turn.x, turn.y, turn.z, turn.w, *content.orientation_covariance, *motion


def _numbers_of_fix(content: Any) -> tuple[float, ...]:
    known = content.position_covariance_type
    return content.longitude, content.latitude, content.status.status, known, *content.position_covariance


_NUMBERS: Mapping[str, Callable[[Any], tuple[float, ...]]] = {
    ODOMETRY: _numbers_of_pose,
    POSE: _numbers_of_pose,
    IMU: _numbers_of_imu,
    FIX: _numbers_of_fix,
    PRESSURE: lambda content: (content.fluid_pressure, content.variance),
}


def _series(recording: Recording, topic: Topic, faults: list[str]) -> _Series:
    times, numbers, count = array("d"), array("d"), 0
    frame = child = ""
    for number, message in enumerate(recording.messages([topic.name], faults)):
        try:
            content = decode(message)
            with refused(f"its {topic.kind} contradicts itself"):
                row = _NUMBERS[topic.kind](content)
                frame = content.header.frame_id.lstrip("/")
                child = BASE if topic.kind == POSE else getattr(content, "child_frame_id", frame).lstrip("/")
                times.append((stamp_of(content.header) or message.time) / 10**9)
                numbers.extend(row)
                count += 1
        except InputError as error:
            faults.append(f"message {number} of {topic.name}: {error}")
    if not count:
        raise InputError(f"{topic.name} cannot be read" + (f": {faults[0]}" if faults else "; record it again"))
    kept, first = np.unique(np.frombuffer(times), return_index=True)
    return _Series(topic.name, kept, np.frombuffer(numbers).reshape(count, -1)[first], frame, child)


def read_recorded_odometry(path: Path, topic: str | None, notes: list[str]) -> Trajectory:
    """Read dead reckoning as T_odom_base with ascending stamps, transformed to base_link if tf_static has the moving
    frame. `topic`: of nav_msgs/Odometry, or of poses; None for the only one."""
    with naming(path):
        faults: list[str] = []
        recording = open_recording(path)
        kinds = (ODOMETRY,) if topic is None and recording.of_kinds((ODOMETRY,)) else (ODOMETRY, POSE)
        series = _series(recording, choose_topic(recording, topic, kinds, path), faults)
        poses = rigid(series.numbers[:, :7], f"the pose of {series.topic}")
        T_odom_base = _R_enu(series.frame) * poses * Frames(recording).T_base(series.child).inv()
        notes += [f"{path}: {fault}" for fault in faults[:_NAMED]]
    return Trajectory(series.times, T_odom_base)


def _R_enu(frame: str, down: bool = False) -> RigidTransform:
    """The rotation to East, North, Up from a world frame."""
    is_ned = down or frame.endswith("_ned")
    return RigidTransform.from_rotation(_R_ENU_NED if is_ned else Rotation.identity())


def recorded_turn_rates(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Ascending times (n,) [s, UTC] and turn rates (n, 3) [rad/s] of the sensor_msgs/Imu topic with the most messages,
    about the axes of base_link if tf_static has the IMU's mounting, otherwise of its own frame (x forward, y left, z
    up)."""
    with naming(path):
        recording = open_recording(path)
        topics = recording.of_kinds((IMU,))
        if not topics:
            raise InputError(f"it has no messages of type {IMU}")
        series = _series(recording, max(topics, key=lambda topic: topic.count), [])  # the scans' reader tells of damage
        rates = series.numbers[:, -3:]
        known = np.isfinite(rates).all(axis=1)
        if not known.any():
            raise InputError(f"none of its messages of type {IMU} can be read")
        R_base_imu = Frames(recording).T_base(series.frame).rotation
        return series.times[known], R_base_imu.apply(rates[known])


def up_in(recording: Recording, frame: str) -> np.ndarray:
    """The direction (3,) of the mean specific force of an IMU in a frame, which points up; 0 if there is none."""
    for topic in recording.of_kinds((IMU,)):
        series = _series(recording, topic, [])
        forces = series.numbers[:, 16:19]
        forces = forces[np.isfinite(forces).all(axis=1)]
        if series.frame == frame and len(forces):
            mean = np.clip(forces, -1e3, 1e3).mean(axis=0)
            if abs(np.linalg.norm(mean) - _GRAVITY) < _ACCELERATION:
                return mean / np.linalg.norm(mean)
    return np.zeros(3)


def read_recorded_navigation(
    path: Path,
    topic: str | None,
    settings: NavigationSettings,
    sigmas: Mapping[str, float] | None,
    scans: np.ndarray,
    notes: list[str],
) -> NavigationLog:
    """The measurements in a recording, of base_link if tf_static has the sensors' mounting. Without a `topic` it reads
    all kinds but odometry, which drifts. Other arguments as of `readers.navigation.overview.read_navigation`."""
    settings.refuse_unused(path, "is a recording", _UNUSED)
    found = list[str]()
    with naming(path):
        recording = open_recording(path)
        reader = _Reader(recording, settings, scans, found)
        parts = [reader.rows_of(each) for each in _chosen(recording, topic, path)]
        times, values, deviations = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        order = np.argsort(times, kind="stable")
        times, values, deviations = times[order], values[order], deviations[order]
        values[deviations >= _UNMEASURED] = np.nan
        bare = (np.isfinite(values) & np.isnan(deviations)).any(axis=0)
        missing = [name for name in np.array(COLUMNS)[bare].tolist() if sigmas is not None and name not in sigmas]
        if missing:
            raise InputError(f"{missing[0]} has no covariance in some messages; give {PRIOR_SIGMAS}")
    notes += [f"{path}: {note}" for note in dict.fromkeys(found)]
    keys = tuple(f"{time:.3f}" for time in times.tolist())
    return NavigationLog("stamp", np.arange(1, len(times) + 1), keys, times, values, deviations, reader.georeference)


def _chosen(recording: Recording, name: str | None, path: Path) -> list[Topic]:
    """The topic called `name`; without one the topics of all kinds that measure the pose in the world."""
    topics = recording.of_kinds(_ABSOLUTE)
    if name is not None or not topics:
        if name is None and recording.of_kinds((ODOMETRY,)):
            odometry = recording.of_kinds((ODOMETRY,))[0].name
            raise InputError(
                f"it has dead reckoning alone, which drifts: use --odometry {path}; if it is corrected, as by a fix, "
                f"name it, as in --priors {path}::{odometry}"
            )
        return [choose_topic(recording, name, (*_ABSOLUTE, ODOMETRY), path)]
    kinds = [topic.kind for topic in topics]
    if len(set(kinds)) < len(kinds) or (POSE in kinds and len(kinds) > 1):
        raise InputError(
            f"several of its topics measure the same: {listed(topics)}; choose, as in --priors {path}::{topics[0].name}"
            f" --priors {path}::{topics[1].name}"
        )
    return sorted(topics, key=lambda topic: _ABSOLUTE.index(topic.kind))


_Rows = tuple[np.ndarray, np.ndarray, np.ndarray]  # times (n,); values and standard deviations (n, 6), as in a log


class _Reader:
    """Reads topics as rows of a log."""

    def __init__(self, recording: Recording, settings: NavigationSettings, scans: np.ndarray, notes: list[str]) -> None:
        self._recording, self._settings, self._scans, self._notes = recording, settings, scans, notes
        self._frames = Frames(recording)
        self._down = settings.frame in DOWN_FRAMES
        self.georeference: Georeference | None = None

    def rows_of(self, topic: Topic) -> _Rows:
        """The rows of a topic."""
        faults: list[str] = []
        series = _series(self._recording, topic, faults)
        self._notes += faults[:_NAMED]
        match topic.kind:
            case "sensor_msgs/msg/NavSatFix":
                return self._of_fixes(series)
            case "sensor_msgs/msg/FluidPressure":
                return self._of_pressures(series)
            case "sensor_msgs/msg/Imu":
                return self._of_imu(series)
        return self._of_poses(series)

    def _T_base(self, frame: str) -> RigidTransform:
        """T_base_frame, of a frame with z down if --nav-frame says so."""
        T = self._frames.T_base(frame)
        is_bare = np.array_equal(T.as_matrix(), np.eye(4))
        return RigidTransform.from_rotation(DOWN) if self._down and is_bare else T

    def _kept(self, series: _Series, usable: np.ndarray, lacking: str) -> np.ndarray:
        """The indices of the usable messages; a note tells how many others lack something."""
        if not usable.any():
            raise InputError(f"all {len(usable):,} messages of {series.topic} are {lacking}")
        if not usable.all():
            count = int((~usable).sum())
            self._notes.append(f"{count:,} of {len(usable):,} messages of {series.topic} are left out: {lacking}")
        return np.flatnonzero(usable)

    def _of_poses(self, series: _Series, covariances: np.ndarray | None = None) -> _Rows:
        """Rows of poses with `covariances` (n, 6, 6) [m, rad], in the order of the message."""
        if covariances is None:
            covariances = series.numbers[:, 7:43].reshape(-1, 6, 6)
        kept = self._kept(series, are_rigid(series.numbers[:, :7]), "without a unit quaternion")
        T_base_child, R_enu = self._T_base(series.child), _R_enu(series.frame, self._down)
        poses = R_enu * rigid(series.numbers[kept, :7], series.topic) * T_base_child.inv()
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # of SciPy: heading and roll are ambiguous at a pitch of 90 degrees
            values = np.atleast_2d(values_of(poses))
            variances = [
                np.einsum("ij,njk,ik->ni", R, covariances[kept, block, block], R)
                for R, block in (
                    (T_base_child.rotation.as_matrix(), slice(3, 6)),
                    (R_enu.rotation.as_matrix(), slice(3)),
                )
            ]
        if self._settings.declination is not None:
            values[:, 2] = (values[:, 2] + self._settings.declination) % 360
        return series.times[kept], values, _sigmas(np.hstack(variances)) * ([180 / np.pi] * 3 + [1.0] * 3)

    def _of_imu(self, series: _Series) -> _Rows:
        """Rows of orientations, or of gravity at the scans' times if there are none."""
        numbers = series.numbers
        if not (are_rigid(numbers[:, :7]) & (numbers[:, 7] != -1)).any():
            return self._of_gravity(series)
        numbers = numbers.copy()
        numbers[numbers[:, 7] == -1, 3:7] = 0.0  # no orientation, by REP-145
        covariances = np.zeros((len(numbers), 6, 6))
        covariances[:, 3:, 3:] = numbers[:, 7:16].reshape(-1, 3, 3)
        oriented = _Series(series.topic, series.times, numbers, series.frame, series.child)
        times, values, deviations = self._of_poses(oriented, covariances)
        if self._settings.declination is None:
            self._notes.append(
                f"the headings of {series.topic} are taken as from true North; if its compass is magnetic, give "
                "--magnetic-declination DEG"
            )
        values[:, 3:] = np.nan
        return times, values, deviations

    def _of_gravity(self, series: _Series) -> _Rows:
        from sonarmap.tools.files.readers.sonar.recording import ImuSamples, attitude_at  # imports an HTTP client

        motion = series.numbers[:, 16:22]
        kept = self._kept(series, np.isfinite(motion).all(axis=1), "without an orientation and accelerations")
        R_base = self._T_base(series.child).rotation
        forces, rates = R_base.apply(motion[kept, :3]), R_base.apply(motion[kept, 3:])
        times = series.times[kept]
        scans = (
            self._scans if len(self._scans) else np.arange(times[0], times[-1] + 1e-3, max(1.0, np.ptp(times) / 1e4))
        )
        rows = list[tuple[float, np.ndarray, np.ndarray]]()
        for stamp in scans.tolist():
            around = slice(*np.searchsorted(times, [stamp - 0.5, stamp + 0.5]))
            if prior := attitude_at(stamp, ImuSamples(times[around], forces[around], rates[around])):
                rows.append((stamp, values_of(prior.T_world_sensor), np.degrees(prior.sigmas)))
        if not rows:
            raise InputError(f"{series.topic} has no orientation, and its accelerations give none at the scans' times")
        self._notes.append(f"{series.topic} has no orientation: roll and pitch are those of its accelerations")
        stamps, values, deviations = (np.array(column) for column in zip(*rows, strict=True))
        values[:, 2:] = np.nan
        return stamps, values, deviations

    def _of_fixes(self, series: _Series) -> _Rows:
        longitude, latitude, status, known = series.numbers[:, :4].T
        usable = (status >= 0) & (np.abs(longitude) <= 180) & (np.abs(latitude) <= 90)
        kept = self._kept(series, usable, "without a fix")
        values, deviations = np.full((2, len(kept), 6), np.nan)
        values[:, 3], values[:, 4] = longitude[kept], latitude[kept]
        covariances = np.where(known[kept, None] > 0, series.numbers[kept, 4:], np.nan)
        deviations[:, 3:5] = _sigmas(covariances[:, [0, 4]])  # East, North
        values, self.georeference = local_places(values, True, self._settings, self._notes)
        return self._of_base(series, kept, values, deviations)

    def _of_pressures(self, series: _Series) -> _Rows:
        pressures, variances = series.numbers.T
        low, high = _PRESSURES
        kept = self._kept(
            series,
            (pressures >= low) & (pressures <= high),
            f"not between {low:,.0f} and {high:,.0f} Pa; wanted absolute pressures in pascal",
        )
        values, deviations = np.full((2, len(kept), 6), np.nan)
        values[:, 5] = (pressures[kept] - _AIR) / (_SEA_WATER * _GRAVITY)
        deviations[:, 5] = _sigmas(variances[kept]) / (_SEA_WATER * _GRAVITY)
        self._notes.append(
            f"depths are the pressures of {series.topic} above {_AIR:,.0f} Pa in salt water of {_SEA_WATER:,.0f} kg/m3;"
            " in fresh water they are 2.5 % larger"
        )
        return self._of_base(series, kept, values, deviations)

    def _of_base(self, series: _Series, kept: np.ndarray, values: np.ndarray, deviations: np.ndarray) -> _Rows:
        """Rows of base_link from those of a sensor beside it. If the attitude is not known, the lever arm is level, and
        its length is an error of the position."""
        lever, times = self._frames.T_base(series.frame).translation, series.times[kept]
        if not lever.any():
            return times, values, deviations
        R_world_base = self._attitude(times)
        if R_world_base is None:
            flat = float(np.hypot(lever[0], lever[1]))
            deviations[:, 3:5] = np.hypot(deviations[:, 3:5], flat)
            deviations[:, 5] = np.hypot(deviations[:, 5], _UNKNOWN_TILT * flat)
            moved = np.array([0.0, 0.0, lever[2]])
        else:
            moved = R_world_base.apply(lever)
        values[:, 3:] -= moved * [1.0, 1.0, -1.0]
        return times, values, deviations

    def _attitude(self, times: np.ndarray) -> Rotation | None:
        """The vehicle's attitude, from the only IMU; None if there is none."""
        topics = self._recording.of_kinds((IMU,))
        if len(topics) != 1:
            return None
        measured, values, _ = self._of_imu(_series(self._recording, topics[0], []))
        if len(measured) < 2 or not np.isfinite(values[:, 2]).all():
            return None
        values[:, 3:] = 0.0
        return Slerp(measured, poses_of(values).rotation)(np.clip(times, measured[0], measured[-1]))


def _sigmas(variances: np.ndarray) -> np.ndarray:
    """Standard deviations; NaN for variances that are not above 0, which messages have where they are unknown."""
    return np.sqrt(np.where(variances > LEAST_SIGMA**2, variances, np.nan))
