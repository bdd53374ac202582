"""The options --priors, --prior-sigmas and those that say how a file of navigation is to be understood."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options import groups
from sonarmap.tools.command.options.registration import parse_prior_sigmas
from sonarmap.tools.command.terminal import say

if TYPE_CHECKING:
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo.georeference import Georeference
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings

AUTO = "auto"
# parameters of the verbs that say how to understand --priors and --odometry
NAVIGATION = (
    "nav_columns",
    "time_scale",
    "nav_offset",
    "nav_crs",
    "nav_frame",
    "mount",
    "heading_reference",
    "magnetic_declination",
)


def _frames(incomplete: str) -> list[str]:
    from sonarmap.tools.files.readers.navigation.settings import DOWN_FRAMES, UP_FRAMES  # imports SciPy

    return groups.completes((*DOWN_FRAMES, *UP_FRAMES))(incomplete)


def _time_scales(incomplete: str) -> list[str]:
    from sonarmap.tools.files.time_scales import TIME_SCALES

    return groups.completes(TIME_SCALES)(incomplete)


NavColumnsOption = Annotated[
    str | None,
    typer.Option(
        "--nav-columns",
        metavar="A=B,...",
        help="What columns of the navigation hold, as in depth_m=KP_DEPTH,heading_deg=Gyro.",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
        show_default="by their names",
    ),
]
TimeScaleOption = Annotated[
    str | None,
    typer.Option(
        "--time-scale",
        metavar="NAME",
        help="Of its times that name no zone: utc, gps or tai.",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
        show_default="utc",
        autocompletion=_time_scales,
    ),
]
NavOffsetOption = Annotated[
    str | None,
    typer.Option(
        "--nav-offset",
        metavar="S",
        help="Add S to its times \\[s]; auto estimates them from the sonar's turn rates.",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
        show_default="0",
        autocompletion=groups.completes((AUTO,)),
    ),
]
NavCrsOption = Annotated[
    str | None,
    typer.Option(
        "--nav-crs",
        metavar="CRS",
        help="Of its eastings and northings, as EPSG:32632.",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
    ),
]
NavFrameOption = Annotated[
    str | None,
    typer.Option(
        "--nav-frame",
        metavar="NAME",
        help="Of its pitch, yaw, x, y, z, and of --mount: frd or ned (forward, right, down; North, East, Down), flu or "
        "enu (forward, left, up; East, North, Up).",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
        show_default="heading, pitch nose up, x East, y North, depth",
        autocompletion=_frames,
    ),
]
MountOption = Annotated[
    str | None,
    typer.Option(
        "--mount",
        metavar="R,P,H[,X,Y,Z]",
        help="The sonar on the vehicle that the navigation is of: roll, pitch, heading \\[deg]; forward, "
        "starboard, down "
        "\\[m].",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
        show_default="the navigation is of the sonar",
    ),
]
HeadingReferenceOption = Annotated[
    str | None,
    typer.Option(
        "--heading-reference",
        metavar="NAME",
        help="North of its headings: true or grid.",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
        show_default="true",
        autocompletion=groups.completes(("true", "grid")),
    ),
]
MagneticDeclinationOption = Annotated[
    float | None,
    typer.Option(
        "--magnetic-declination",
        metavar="DEG",
        help="Its headings are magnetic: add DEG to them, East positive.",
        rich_help_panel=groups.NAVIGATION,
        hidden=True,
    ),
]


def navigation_settings(options: Mapping[str, Any], origin: "Georeference | None" = None) -> "NavigationSettings":
    """How to understand the files of --priors and --odometry.

    Args:
        options: of the verb, by their parameters' names.
        origin: of the map's frame; None for the first fix.

    Raises:
        InputError: what they say cannot be, or there is no file that they could be of.
    """
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings, parse_columns, parse_mount

    given = {name: options[name] for name in NAVIGATION if options.get(name) is not None}
    if given and options.get("priors") is None and options.get("odometry") is None:
        flag = f"--{next(iter(given)).replace('_', '-')}"
        raise InputError(f"{flag} has no effect without a file of navigation; give --priors too, or leave it out")
    frame = given.get("nav_frame")
    return NavigationSettings(
        time_scale=given.get("time_scale"),
        offset=_offset(given.get("nav_offset", "0")),
        crs=given.get("nav_crs"),
        origin=origin,
        heading_reference=given.get("heading_reference", "true"),
        declination=given.get("magnetic_declination"),
        frame=frame,
        columns=parse_columns(given.get("nav_columns", "")),
        mount=parse_mount(given["mount"], frame) if "mount" in given else None,
    )


def navigation_summary(options: Mapping[str, Any]) -> dict[str, Any]:
    """What was given, for the summary, so that the same command can be given again."""
    names = ("priors", "prior_sigmas", "odometry", "odometry_drift", *NAVIGATION)
    given = {name: options[name] for name in names if options.get(name) is not None}
    return {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}


def _offset(text: str) -> float | None:
    if text == AUTO:
        return None
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"--nav-offset is {text!r}; wanted seconds, or auto") from error


def scans_with_priors(
    scans: "Sequence[Scan]",
    priors: Path | None,
    prior_sigmas: str | None,
    imu: bool,
    allow_unknown: bool,
    settings: "NavigationSettings",
    files: "Sequence[Path]" = (),
) -> "Navigated":
    """The scans with the priors of the file, and a note if some have none; without a file, the scans as they are.

    What a recording says of its scans' attitude counts only without a file, and a note says either.

    Args:
        scans: as they were read.
        priors, prior_sigmas, imu: the options.
        allow_unknown: whether the file may have rows for other scans.
        settings: how to understand the file.
        files: of the scans; a recording with an IMU among them tells how far the navigation's clock is off.

    Raises:
        InputError: the file cannot be used, or there are --prior-sigmas without a file.
    """
    from sonarmap.tools.files.readers.navigation.priors import Navigated, navigate

    if priors is None:
        if prior_sigmas is not None:
            raise InputError("--prior-sigmas has no effect without --priors; give --priors too, or leave it out")
        _note_own(scans, "roll and pitch are those of the recording's own IMU" if imu else "their own IMU is not used")
        return Navigated(tuple(scans if imu else _without_priors(scans)), settings.origin)
    _note_own(scans, f"the recording's own IMU is not used, as {priors} is given")
    scans = _without_priors(scans)
    sigmas = parse_prior_sigmas(prior_sigmas) if prior_sigmas else {}
    notes: list[str] = []
    turn_rates = None
    if settings.offset is None:
        from sonarmap.tools.files.readers.sonar.imu import vertical_turn_rates

        turn_rates = vertical_turn_rates(files)
    navigated = navigate(scans, priors, settings, sigmas, allow_unknown, notes, turn_rates)
    for note in notes:
        say(note)
    bare = [scan.name for scan in navigated.scans if scan.prior is None]
    if bare:
        say(f"{len(bare)} of {len(scans)} scans have no prior in {priors}: {bare[0]}{' ...' if len(bare) > 1 else ''}")
    return navigated


def _without_priors(scans: "Sequence[Scan]") -> "list[Scan]":
    return [scan if scan.prior is None else replace(scan, prior=None) for scan in scans]


def _note_own(scans: "Sequence[Scan]", note: str) -> None:
    own = sum(scan.prior is not None for scan in scans)
    if own:
        say(f"{own:,} of {len(scans):,} scans: {note}")
