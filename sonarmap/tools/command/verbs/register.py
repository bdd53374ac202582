"""`sonarmap register`: register one scan to another."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.tools.command.method import ConfiguredMethod, configure_method, method_options
from sonarmap.tools.command.moved_scan import WriteOption, require_new_name, write_moved
from sonarmap.tools.command.navigation import (
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
from sonarmap.tools.command.options.registration import (
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
from sonarmap.tools.command.options.scan import (
    FrameOption,
    ImuOption,
    RangeScaleOption,
    SoundSpeedOption,
    UnitsOption,
    corrections_of,
)
from sonarmap.tools.command.picture import PictureOption, draw_picture, require_steps
from sonarmap.tools.command.terminal import printable, say
from sonarmap.tools.command.words.registration import print_registration
from sonarmap.tools.command.words.survey import warn
from sonarmap.tools.methods.registry import DEFAULT_METHOD

if TYPE_CHECKING:
    from sonarmap.spectral.result import Registration
    from sonarmap.spectral.scan import Scan

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
    write: WriteOption = None,
    picture: PictureOption = None,
    as_json: JsonOption = False,
) -> None:
    """Register SOURCE to TARGET: print the transform between two scans, its uncertainty, and whether it is reliable.

    p_target = T_target_source p_source, in meters. The exit code is 0 if the registration is reliable, 3 if it is not,
    2 for bad input.
    """
    options = method_options(context)
    require_steps(picture, options.name)
    scans = _scans(context.params, imu and options.uses_priors)
    configured = configure_method(scans, options)
    prepared_target, prepared_source = (configured.registrar.prepare(scan) for scan in scans)
    registration = configured.registrar.register(prepared_target, prepared_source)
    written = write if registration.accepted else None
    if written is not None:
        write_moved(written, scans[1], registration.T_target_source)
    if picture is not None:
        draw_picture(picture, configured.registrar, prepared_target, prepared_source, registration)
    if as_json:
        typer.echo(json.dumps(_as_json(registration, configured, written), allow_nan=False))
    else:
        print_registration(registration, configured)
        if written is not None:
            typer.echo(f"\nwritten to {printable(str(written))}: the source's points in the target's frame")
    if write is not None and written is None:
        warn(f"{write} is not written, as the registration is not reliable")
    if not registration.accepted:
        raise typer.Exit(UNRELIABLE)


def _scans(given: Mapping[str, Any], use_imu: bool) -> "Sequence[Scan]":
    """Target and source, with what instruments measured of them.

    Args:
        given: the verb's options, by their parameters' names.
        use_imu: whether a recording's own attitude counts.
    """
    from sonarmap.tools.files.readers.scans import only_scan, read_scans

    corrections, navigation = corrections_of(given), navigation_settings(given)
    scans, files = [], []
    for path in (given["target"], given["source"]):
        read = read_scans([path], corrections)
        for note in read.notes:
            say(note)
        scans.append(only_scan(path, read))
        files += read.files
    if given["write"] is not None:
        require_new_name(given["write"], files)
    return scans_with_priors(scans, given["priors"], given["prior_sigmas"], use_imu, True, navigation).scans


def _as_json(registration: "Registration", method: ConfiguredMethod, written: Path | None = None) -> dict[str, object]:
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
        **({} if written is None else {"written": str(written)}),
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
