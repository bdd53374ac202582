"""The options --priors and --odometry, and those that describe the contents of navigation files."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from sonarmap.kernels.errors import InputError, SonarmapError
from sonarmap.tools.command.option import NAVIGATION, given, refuse_without, refused_by
from sonarmap.tools.command.terminal import say

if TYPE_CHECKING:
    from sonarmap.slam.motion.odometry import Odometry
    from sonarmap.slam.pair import RegisteredPair
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo import Georeference
    from sonarmap.tools.files.readers.navigation.correction import Correction
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.navigation.settings import NavFrame, NavigationSettings
    from sonarmap.tools.files.time_scales import TimeScale
    from sonarmap.tools.products.output.trial import MeasuredScans

DEFAULT_DRIFT = "1,10"
_rare = partial(NAVIGATION.option, rare=True)

ImuOption = Annotated[
    bool, NAVIGATION.switch("--imu/--no-imu", "Use roll and pitch of the recording's own IMU.", rare=True)
]


def parse_prior_sigmas(text: str) -> dict[str, float]:
    """Standard deviations for the columns of a priors file, from "attitude,heading,depth,position" [deg, m]."""
    from sonarmap.tools.files.readers.instruments import COLUMNS, LARGEST, LEAST_SIGMA

    try:
        attitude, heading, depth, position = (float(part) for part in text.split(","))
    except ValueError:
        attitude = heading = depth = position = math.nan
    sigmas = (attitude, attitude, heading, position, position, depth)
    if not all(LEAST_SIGMA <= sigma <= LARGEST for sigma in sigmas):
        raise InputError(f"--prior-sigmas is {text!r}; wanted four numbers above 0, as in --prior-sigmas 0.5,3,0.1,3")
    return dict(zip(COLUMNS, sigmas, strict=True))


def _parse_correction(text: str) -> "Correction":
    from sonarmap.tools.files.readers.navigation.correction import Correction

    return Correction.of(text)


@dataclass(frozen=True, slots=True)
class PriorsFile:
    """--priors, --prior-sigmas and --correct-priors: measured poses of the scans."""

    priors: list[Path] = NAVIGATION.option(
        "FILE",
        "Measured poses: a CSV, TUM or NMEA 0183 log, or a ROS bag or MCAP (FILE::TOPIC). CSV columns: name or stamp, "
        "then any of roll_deg, pitch_deg, heading_deg, x_m, y_m, depth_m; roll_sigma_deg and so on. `sonarmap inspect "
        "--template` writes such a table. Repeat it for files with other quantities or scans.",
        [],
    )
    prior_sigmas: str | None = NAVIGATION.option(
        "A,H,D,P",
        "Standard deviations where the priors file has none: attitude, heading \\[deg], depth, position \\[m].",
        callback=refused_by(parse_prior_sigmas),
    )
    correct_priors: str | None = _rare(
        "COLUMN=...",
        "Correct the priors, by columns of a CSV: heading_deg=-heading_deg or x_m=0.3048*x_m,y_m=0.3048*y_m. Messages "
        "about a mistake in the navigation name the correction.",
        callback=refused_by(_parse_correction),
    )

    @property
    def sigmas(self) -> dict[str, float] | None:
        """Standard deviations of --prior-sigmas by column; None without the option."""
        return parse_prior_sigmas(self.prior_sigmas) if self.prior_sigmas else None

    def applied(self, settings: "NavigationSettings") -> "NavigationSettings":
        """The settings with these options."""
        correction = None if self.correct_priors is None else _parse_correction(self.correct_priors)
        return replace(settings, sigmas=self.sigmas or settings.sigmas, correction=correction)

    @property
    def named(self) -> str:
        """Names of the files, for messages."""
        return " and ".join(map(str, self.priors))


@dataclass(frozen=True, slots=True)
class OdometryFile:
    """Options of dead reckoning."""

    odometry: Path | None = NAVIGATION.option(
        "FILE",
        "Dead reckoning with times of its own: TUM, CSV (stamp and the columns of a priors file), SBET, reports of a "
        "Water Linked DVL, ROS bag or MCAP (FILE::TOPIC).",
    )
    odometry_drift: str | None = _rare(
        "P,D",
        "Standard deviation of the dead reckoning: percent of the distance \\[%], degrees per hour \\[deg/h].",
        shown=DEFAULT_DRIFT,
    )

    @property
    def drift(self) -> tuple[float, float]:
        """Standard deviation of dead reckoning: a share of the distance, and a rotation per second [rad/s]."""
        from sonarmap.tools.files.readers.navigation.odometry import parse_drift

        return parse_drift(self.odometry_drift or DEFAULT_DRIFT)

    def read(self, scans: "Sequence[Scan]", settings: "NavigationSettings") -> "Odometry | None":
        """The dead reckoning at the scans' times; None without a file."""
        if self.odometry is None:
            refuse_without("--odometry", {"--odometry-drift": self.odometry_drift})
            return None
        from sonarmap.tools.files.readers.navigation.odometry import read_odometry

        notes: list[str] = []
        odometry = read_odometry(self.odometry, scans, *self.drift, notes, settings)
        for note in notes:
            say(note)
        return odometry


@dataclass(frozen=True, slots=True)
class NavigationReading:
    """Options that describe the contents of --priors and --odometry."""

    nav_columns: str | None = _rare(
        "A=B,...", "Names of the log's columns, as depth_m=KP_DEPTH,heading_deg=Gyro.", shown="by their names"
    )
    time_scale: str | None = _rare(
        "NAME",
        "Time scale of log times without a time zone: utc, gps or tai.",
        shown="utc",
    )
    nav_offset: float | None = _rare("S", "Add S to the log's times \\[s].", shown="0")
    nav_crs: str | None = _rare("CRS", "CRS of the log's eastings and northings, e.g. EPSG:32632.")
    nav_frame: str | None = _rare(
        "NAME",
        "Axes of the log's pitch, yaw, x, y, z and of --mount: frd or ned (forward, right, down; North, East, Down), "
        "flu or enu (forward, left, up; East, North, Up).",
        shown="heading, pitch nose up, x East, y North, depth",
    )
    mount: str | None = _rare(
        "R,P,H[,X,Y,Z]",
        "How the sonar is mounted on the vehicle: roll, pitch, heading \\[deg], optionally forward, starboard, down "
        "\\[m].",
        shown="the navigation is of the sonar",
    )
    heading_reference: str | None = _rare(
        "NAME",
        "North that the log's headings count from: true or grid.",
        shown="true",
    )
    nmea_talker: str | None = _rare(
        "AA,...", "NMEA talkers whose positions and headings are used, e.g. GP,HE.", shown="all that agree"
    )
    magnetic_declination: float | None = _rare("DEG", "Add DEG to the log's magnetic headings, East positive.")

    def settings(self, *files: Path | None, origin: "Georeference | None" = None) -> "NavigationSettings":
        """The settings with which the readers read `files`; `origin` is the map's, None for the first fix."""
        from sonarmap.tools.files.readers.navigation.settings import (
            NavigationSettings,
            parse_columns,
            parse_mount,
            parse_talkers,
        )

        if (options := given(self)) and not any(files):
            flag = f"--{next(iter(options)).replace('_', '-')}"
            raise InputError(f"{flag} has no effect without a file of navigation; give --priors too, or leave it out")
        frame = cast("NavFrame | None", self.nav_frame)  # NavigationSettings refuses other names
        return NavigationSettings(
            time_scale=cast("TimeScale | None", self.time_scale),
            offset=0.0 if self.nav_offset is None else self.nav_offset,
            crs=self.nav_crs,
            origin=origin,
            heading_reference="true" if self.heading_reference is None else self.heading_reference,
            declination=self.magnetic_declination,
            frame=frame,
            columns=parse_columns(self.nav_columns or ""),
            mount=None if self.mount is None else parse_mount(self.mount, frame),
            talkers=() if self.nmea_talker is None else parse_talkers(self.nmea_talker),
            are_shared=sum(file is not None for file in files) > 1,
        )


def scans_with_priors(
    scans: "Sequence[Scan]",
    file: PriorsFile,
    settings: "NavigationSettings",
    use_imu: bool = True,
    allow_unknown: bool = False,
) -> "Navigated":
    """The scans with the priors of the file, or without a file with the attitude of their recording's IMU if `use_imu`.
    Messages say which of the two is used, and how many scans have no prior. `allow_unknown`: the file may have rows for
    other scans."""
    from sonarmap.tools.files.readers.navigation.priors import Navigated, navigate

    with_imu = sum(scan.prior is not None for scan in scans)
    if not file.priors:
        refuse_without("--priors", {"--prior-sigmas": file.prior_sigmas, "--correct-priors": file.correct_priors})
        note = "roll and pitch are those of the recording's own IMU" if use_imu else "their own IMU is not used"
    else:
        note = f"the recording's own IMU is not used, as {file.named} is given"
    if with_imu:
        say(f"{with_imu:,} of {len(scans):,} scans: {note}")
    if file.priors or not use_imu:
        scans = [scan if scan.prior is None else replace(scan, prior=None) for scan in scans]
    if not file.priors:
        return Navigated(tuple(scans), settings.origin)
    settings = file.applied(settings)
    notes = list[str]()
    navigated = navigate(scans, file.priors, settings, allow_unknown, notes)
    bare = [scan.name for scan in navigated.scans if scan.prior is None]
    if bare:
        more = " ..." if len(bare) > 1 else ""
        notes.append(f"{len(bare)} of {len(scans)} scans have no prior in {file.named}: {bare[0]}{more}")
    for note in notes:
        say(note)
    return navigated


class ContradictedError(SonarmapError):
    """Raised for navigation that the scans contradict, as it would distort the map."""


def refusing(measured: "MeasuredScans") -> "Callable[[Sequence[RegisteredPair]], None]":
    """A check that the mapper calls with pairs registered without the priors: it raises ContradictedError if they
    contradict the priors for a known reason."""

    def vet(free: "Sequence[RegisteredPair]") -> None:
        if (found := measured.contradiction(free)) is not None:
            raise ContradictedError(f"{measured.finding(found).words} (docs/navigation.md)")

    return vet
