"""Options that several verbs share, each with its check; a verb declares one as `grid: GridOption = None`."""

import math
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.options.groups import NAVIGATION, REGISTRATION, RUNNING, completes
from sonarmap.tools.methods.registry import METHODS, find_method

DEFAULT_EDGE = 128
DEFAULT_HYPOTHESES, MOST_HYPOTHESES = 6, 64
REFINEMENTS = ("icp", "spectral")
DEFAULT_REFINEMENT = REFINEMENTS[0]
DEFAULT_YAW_PEAKS, MOST_YAW_PEAKS = 1, 32
DEFAULT_SEED = 0
DEFAULT_MAX_TILT = 35.0  # [deg], the paper's range of roll and pitch (Sect. 2.7)


def _devices(incomplete: str) -> list[tuple[str, str]]:
    """What a shell completes: kinds, and the devices of this machine with their names."""
    from sonarmap.kernels.device.device import device_names
    from sonarmap.kernels.errors import DeviceError

    known = [("cpu", "the processor"), ("gpu", "a graphics card")]
    with suppress(DeviceError):
        known += device_names()
    return [(selector, name) for selector, name in known if selector.startswith(incomplete)]


def _check_edge(edge: int | None) -> int | None:
    if edge is None:
        return None
    from sonarmap.spectral.grid import Grid  # imports SciPy, which the help can do without

    try:
        return Grid(edge, 1.0).edge
    except InputError as error:
        raise typer.BadParameter(f"{as_options(str(error))}, or leave it out for {DEFAULT_EDGE}.") from error


def _check_voxel(voxel: float | None) -> float | None:
    if voxel is None or (math.isfinite(voxel) and voxel > 0):
        return voxel
    raise typer.BadParameter(
        f"{voxel} m; give a length above 0, about the size of the noise, as in --voxel 0.5, or leave it out to have it "
        "chosen from the extents of the scans."
    )


def check_tilt(tilt: float) -> float:
    """The angle, if it can bound roll and pitch [degrees]."""
    if 0 < tilt <= 180:
        return tilt
    raise typer.BadParameter(
        f"{tilt} degrees; give more than 0 and at most 180 (no limit): how far the vehicle can roll and pitch. Leave "
        f"it out for {DEFAULT_MAX_TILT:g}."
    )


def _check_hypotheses(count: int) -> int:
    if 1 <= count <= MOST_HYPOTHESES:
        return count
    raise typer.BadParameter(
        f"{count} rotations; give 1 to {MOST_HYPOTHESES}. Use --hypotheses {DEFAULT_HYPOTHESES}, or more if the scans "
        "have little in common."
    )


def _check_refinement(name: str) -> str:
    if name in REFINEMENTS:
        return name
    raise typer.BadParameter(f"{name!r}; choose {' or '.join(REFINEMENTS)}. Leave it out for {DEFAULT_REFINEMENT}.")


def _check_yaw_peaks(count: int) -> int:
    if 1 <= count <= MOST_YAW_PEAKS:
        return count
    raise typer.BadParameter(
        f"{count} peaks; give 1 to {MOST_YAW_PEAKS}. Use --yaw-peaks 6, or leave it out for the paper's "
        f"{DEFAULT_YAW_PEAKS}."
    )


def _check_method(name: str) -> str:
    try:
        find_method(name)
    except InputError as error:
        raise typer.BadParameter(as_options(str(error))) from error
    return name


def parse_prior_sigmas(text: str) -> dict[str, float]:
    """Standard deviations for the columns of a priors file, from "attitude,heading,depth,position" [deg, m].

    Raises:
        InputError: not four numbers above 0.
    """
    from sonarmap.tools.files.readers.instruments import COLUMNS
    from sonarmap.tools.files.readers.limits import LARGEST, LEAST_SIGMA

    try:
        attitude, heading, depth, position = (float(part) for part in text.split(","))
    except ValueError:
        attitude = heading = depth = position = math.nan
    sigmas = (attitude, attitude, heading, position, position, depth)
    if not all(LEAST_SIGMA <= sigma <= LARGEST for sigma in sigmas):
        raise InputError(
            f"--prior-sigmas is {text!r}; give four numbers above 0, separated by commas: for roll and pitch [deg], "
            "heading [deg], depth [m], x and y [m], as in --prior-sigmas 0.5,3,0.1,3"
        )
    return dict(zip(COLUMNS, sigmas, strict=True))


def _check_prior_sigmas(text: str | None) -> str | None:
    if text is None:
        return None
    try:
        parse_prior_sigmas(text)
    except InputError as error:
        raise typer.BadParameter(str(error)) from error
    return text


def check_seed(seed: int | None) -> int | None:
    """The seed, if there is one and every random generator can use it."""
    if seed is None or 0 <= seed < 2**63:
        return seed
    raise typer.BadParameter(f"{seed}; give a whole number from 0 to 2^63 - 1, as in --seed 1.")


MethodOption = Annotated[
    str,
    typer.Option(
        "--method",
        metavar="NAME",
        help=f"How to register. Methods: {', '.join(METHODS)}.",
        callback=_check_method,
        rich_help_panel=REGISTRATION,
        autocompletion=completes(METHODS),
    ),
]
GridOption = Annotated[
    int | None,
    typer.Option(
        "--grid",
        metavar="N",
        help="Voxels per edge, 16..512. The number is an even product of 2, 3 and 5.",
        callback=_check_edge,
        rich_help_panel=REGISTRATION,
        show_default=f"{DEFAULT_EDGE}",
    ),
]
VoxelOption = Annotated[
    float | None,
    typer.Option(
        "--voxel",
        metavar="M",
        help="Edge of a voxel \\[m].",
        callback=_check_voxel,
        rich_help_panel=REGISTRATION,
        show_default="suits the scans",
    ),
]
MaxTiltOption = Annotated[
    float,
    typer.Option(
        "--max-tilt",
        metavar="DEG",
        help="Largest tilt between scans \\[deg]. It bounds roll and pitch; 180 is no limit. Larger results are "
        "rejected. "
        "--method hemisphere searches up to 85.",
        callback=check_tilt,
        rich_help_panel=REGISTRATION,
    ),
]
HypothesesOption = Annotated[
    int,
    typer.Option(
        "--hypotheses",
        metavar="K",
        help="How many candidate rotations to try of each of three frequency bands, "
        f"1..{MOST_HYPOTHESES}; more help where scans have little in common.",
        callback=_check_hypotheses,
        rich_help_panel=REGISTRATION,
        hidden=True,
    ),
]
RefineOption = Annotated[
    str,
    typer.Option(
        "--refine",
        metavar="HOW",
        help="How to refine the result below the voxel size: icp (point to plane) or spectral (the translation peak).",
        callback=_check_refinement,
        rich_help_panel=REGISTRATION,
        hidden=True,
        autocompletion=completes(REFINEMENTS),
    ),
]
YawPeaksOption = Annotated[
    int,
    typer.Option(
        "--yaw-peaks",
        metavar="K",
        help=f"For --method hemisphere: how many yaw peaks to try, 1..{MOST_YAW_PEAKS}; the paper tries 1.",
        callback=_check_yaw_peaks,
        rich_help_panel=REGISTRATION,
        hidden=True,
    ),
]
StrengthOption = Annotated[
    bool,
    typer.Option(
        "--strength/--no-strength",
        help="Weight voxels by their echo strength; otherwise, as in the paper, all count the same.",
        rich_help_panel=REGISTRATION,
        hidden=True,
    ),
]
DeviceOption = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="DEVICE",
        help="OpenCL device: cpu, gpu, or a part of its name. platform:device too; `sonarmap devices` lists them.",
        rich_help_panel=RUNNING,
        autocompletion=_devices,
    ),
]
PriorsOption = Annotated[
    Path | None,
    typer.Option(
        "--priors",
        metavar="FILE",
        help="Measured poses: a CSV, TUM or NMEA 0183 log. CSV has name or stamp; roll_deg, pitch_deg, "
        "heading_deg, x_m, y_m, depth_m; roll_sigma_deg and so on. `sonarmap template` writes such a table to fill in.",
        rich_help_panel=NAVIGATION,
    ),
]
PriorSigmasOption = Annotated[
    str | None,
    typer.Option(
        "--prior-sigmas",
        metavar="A,H,D,P",
        help="Standard deviations where the priors file has none: attitude, heading \\[deg], depth, position \\[m].",
        callback=_check_prior_sigmas,
        rich_help_panel=NAVIGATION,
        hidden=True,
    ),
]
SeedOption = Annotated[
    int,
    typer.Option(
        "--seed",
        metavar="S",
        help="Seed for methods that use random numbers. The same seed gives the same result.",
        callback=check_seed,
        rich_help_panel=REGISTRATION,
        hidden=True,
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, without progress.", rich_help_panel=RUNNING)
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.", rich_help_panel=RUNNING)
]
