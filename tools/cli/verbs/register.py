"""`sonarmap register`: register one scan to another."""

import json
import math
from typing import TYPE_CHECKING, Annotated

import typer

from tools.cli.arguments import as_options
from tools.cli.method import ConfiguredMethod, configure_method, method_options
from tools.cli.navigation import (
    HeadingReferenceOption,
    MagneticDeclinationOption,
    MountOption,
    NavColumnsOption,
    NavCrsOption,
    NavFrameOption,
    NavOffsetOption,
    TimeScaleOption,
    navigation_settings,
    scans_with_priors,
)
from tools.cli.options.registration import (
    DEFAULT_HYPOTHESES,
    DEFAULT_MAX_TILT,
    DEFAULT_REFINEMENT,
    DEFAULT_SEED,
    DEFAULT_YAW_PEAKS,
    DeviceOption,
    GridOption,
    HypothesesOption,
    JsonOption,
    MaxTiltOption,
    MethodOption,
    PriorSigmasOption,
    PriorsOption,
    RefineOption,
    SeedOption,
    StrengthOption,
    VoxelOption,
    YawPeaksOption,
)
from tools.cli.options.scan import (
    FrameOption,
    ImuOption,
    RangeScaleOption,
    SoundSpeedOption,
    UnitsOption,
    corrections_of,
)
from tools.cli.picture import PictureOption, draw_picture, require_steps
from tools.cli.terminal import printable, result_console, say
from tools.methods.registry import DEFAULT_METHOD

if TYPE_CHECKING:
    from spectral.result import Registration
    from spectral.scan import Scan
    from tools.readers.corrections import Corrections

UNRELIABLE = 3


def command(
    context: typer.Context,
    target: Annotated[str, typer.Argument(help="The scan that stays where it is.", metavar="TARGET")],
    source: Annotated[str, typer.Argument(help="The scan that is moved onto the target.", metavar="SOURCE")],
    method: MethodOption = DEFAULT_METHOD,
    grid: GridOption = None,
    voxel: VoxelOption = None,
    max_tilt: MaxTiltOption = DEFAULT_MAX_TILT,
    hypotheses: HypothesesOption = DEFAULT_HYPOTHESES,
    refine: RefineOption = DEFAULT_REFINEMENT,
    yaw_peaks: YawPeaksOption = DEFAULT_YAW_PEAKS,
    strength: StrengthOption = False,
    priors: PriorsOption = None,
    prior_sigmas: PriorSigmasOption = None,
    imu: ImuOption = True,
    sound_speed: SoundSpeedOption = None,
    range_scale: RangeScaleOption = None,
    frame: FrameOption = None,
    units: UnitsOption = None,
    nav_columns: NavColumnsOption = None,
    time_scale: TimeScaleOption = None,
    nav_offset: NavOffsetOption = None,
    nav_crs: NavCrsOption = None,
    nav_frame: NavFrameOption = None,
    mount: MountOption = None,
    heading_reference: HeadingReferenceOption = None,
    magnetic_declination: MagneticDeclinationOption = None,
    device: DeviceOption = None,
    seed: SeedOption = DEFAULT_SEED,
    picture: PictureOption = None,
    as_json: JsonOption = False,
) -> None:
    """Register SOURCE to TARGET: print the transform between two scans, its uncertainty, and whether it is reliable.

    p_target = T_target_source p_source, in meters. The exit code is 0 if the registration is reliable, 3 if it is not,
    2 for bad input.
    """
    options = method_options(context)
    require_steps(picture, options.name)
    corrections = corrections_of(context.params)
    navigation = navigation_settings(context.params)
    read = [_read(path, corrections) for path in (target, source)]
    use_imu = imu and options.uses_priors
    scans = scans_with_priors(read, priors, prior_sigmas, use_imu, True, navigation).scans
    configured = configure_method(scans, options)
    prepared_target, prepared_source = (configured.registrar.prepare(scan) for scan in scans)
    registration = configured.registrar.register(prepared_target, prepared_source)
    if picture is not None:
        draw_picture(picture, configured.registrar, prepared_target, prepared_source, registration)
    if as_json:
        typer.echo(json.dumps(_as_json(registration, configured), allow_nan=False))
    else:
        _print(registration, configured)
    if not registration.accepted:
        raise typer.Exit(UNRELIABLE)


def _read(path: str, corrections: "Corrections") -> "Scan":
    from tools.readers.scans import only_scan, read_scans

    read = read_scans([path], corrections)
    for note in read.notes:
        say(note)
    return only_scan(path, read)


def _as_json(registration: "Registration", method: ConfiguredMethod) -> dict[str, object]:
    """The registration as JSON; null for what the method does not have, such as a peak or a grid."""
    return {
        "T_target_source": registration.T_target_source.as_matrix().tolist(),
        "covariance": registration.covariance.tolist(),
        "accepted": registration.accepted,
        "probability": _or_null(registration.probability),
        "psr": _or_null(registration.psr),
        "overlap": registration.overlap,
        "seconds": registration.seconds,
        "reason": registration.reason,
        "step_psr": dict(registration.step_psr),
        "alternatives": [_alternative(hypothesis) for hypothesis in registration.alternatives],
        "method": method.name,
        "grid": method.edge,
        "voxel": method.grid.voxel,
    }


def _doubts(registration: "Registration") -> dict[str, str]:
    """How probable the transform is and how many others are possible, if the method says so."""
    if not math.isfinite(registration.probability):
        return {}
    count = len(registration.alternatives)
    others = f"{count} other {'transform' if count == 1 else 'transforms'} could not be excluded"
    return {
        "probability": f"{registration.probability:.1%} that this transform is right",
        "alternatives": others if count else "every other transform could be excluded",
    }


def _alternative(hypothesis: "Registration") -> dict[str, object]:
    """Another hypothesis that could not be excluded."""
    return {
        "T_target_source": hypothesis.T_target_source.as_matrix().tolist(),
        "covariance": hypothesis.covariance.tolist(),
        "probability": _or_null(hypothesis.probability),
        "psr": _or_null(hypothesis.psr),
        "overlap": hypothesis.overlap,
    }


def _or_null(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _print(registration: "Registration", method: ConfiguredMethod) -> None:
    import numpy as np
    from rich.table import Table
    from rich.text import Text

    from slam.graph.sigma import worst_sigmas

    T = registration.T_target_source
    yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True)
    rotation, translation = worst_sigmas(registration.covariance)
    shift = "  ".join(f"{axis} {v:+.3f}" for axis, v in zip("xyz", T.translation, strict=True))
    cube = f"{method.edge} x {method.edge} x {method.edge} " if method.edge else ""
    rows = {
        "because": as_options(registration.reason),
        **_doubts(registration),
        "translation": f"{shift}  m",
        "rotation": f"yaw {yaw:+.2f}  roll {roll:+.2f}  pitch {pitch:+.2f}  degrees",
        "uncertainty": f"{np.rad2deg(rotation):.2f} degrees, {translation:.3f} m "
        "(one standard deviation, in the worst direction)",
        "overlap": f"{registration.overlap:.0%} of the points lie close to a point of the other scan",
        "method": method.name,
        "grid": f"{cube}voxels of {method.grid.voxel:.3g} m",
        "time": f"{registration.seconds:.2f} s, not counting reading and preparing the scans",
    }
    table = Table(box=None, pad_edge=False, show_header=False)
    for name, value in rows.items():
        table.add_row(f"  {name}", Text(printable(value)))
    typer.echo("registered" if registration.accepted else "NO RELIABLE REGISTRATION; do not use this transform")
    result_console().print(table)
