"""`sonarmap register`: register one scan to another."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import as_options
from sonarmap.tools.command.method import ConfiguredMethod, MethodOptions, configure_method, require_effect
from sonarmap.tools.command.navigation import ImuOption, NavigationReading, PriorsFile, scans_with_priors
from sonarmap.tools.command.option import OUTPUT, JsonOption, checked
from sonarmap.tools.command.survey import PointReading
from sonarmap.tools.command.terminal import print_json, print_rows, printable, result_console, say, warn

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from sonarmap.spectral.result import Registration
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.readers.scans import Corrections

UNRELIABLE = 3


def command(
    target: Annotated[str, typer.Argument(help="The scan that is not moved.", metavar="TARGET")],
    source: Annotated[str, typer.Argument(help="The scan that is moved onto the target.", metavar="SOURCE")],
    method: MethodOptions,
    priors: PriorsFile,
    points: PointReading,
    reading: NavigationReading,
    out: Path | None = OUTPUT.option(
        "FILE",
        "Write the moved scan as PLY: the source's points in the target's frame. "
        "Nothing is written if the registration is not reliable.",
        None,
        *("-o", "--out"),
        callback=checked(
            lambda path: path.suffix.lower() == ".ply", "{}; give a name that ends in .ply, as in -o moved.ply"
        ),
    ),
    imu: ImuOption = True,
    as_json: JsonOption = False,
) -> None:
    """Register SOURCE to TARGET: print the transform between two scans, its uncertainty, and whether it is reliable.

    p_target = T_target_source p_source, in meters. The exit code is 0 if the registration is reliable, 3 if it is not,
    2 for bad input.
    """
    require_effect(method, bool(priors.priors))
    navigation = reading.settings(*priors.priors)
    pair = _read((target, source), points.corrections(), out)
    scans = scans_with_priors(pair, priors, navigation, imu and method.uses_priors, allow_unknown=True).scans
    configured = configure_method(scans, method)
    registration = configured.registrar.register(*(configured.registrar.prepare(scan) for scan in scans))
    written = out if registration.accepted else None
    if written is not None:
        write_moved(written, scans[1], registration.T_target_source)
    if as_json:
        print_json(_as_json(registration, configured, written))
    else:
        print_registration(registration, configured)
        if written is not None:
            typer.echo(f"\nwritten to {printable(str(written))}: the source's points in the target's frame")
    if out is not None and written is None:
        warn(f"{out} is not written, as the registration is not reliable")
    if not registration.accepted:
        raise typer.Exit(UNRELIABLE)


def _read(paths: Sequence[str], corrections: "Corrections", write: Path | None) -> "list[Scan]":
    """Read the scan of each path; refuse an output that would replace one of their files, or cannot be written."""
    from sonarmap.tools.files.readers.scans import only_scan, read_scans
    from sonarmap.tools.files.writers.atomic import require_writable

    scans, files = [], []
    for path in paths:
        read = read_scans([path], corrections)
        for note in read.notes:
            say(note)
        scans.append(only_scan(path, read))
        files += read.files
    if write is not None:
        for source in files:
            if source.resolve() == write.resolve():
                raise InputError(f"-o {write} would replace {source}, which is read here; give another name")
        require_writable(write.parent)
    return scans


def write_moved(path: Path, scan: "Scan", T_target_source: "RigidTransform") -> None:
    """Write a scan in the target's frame [m] as PLY, its strengths as `intensity` and its viewpoints as vp_x, vp_y and
    vp_z. p_target = T p_source."""
    from sonarmap.tools.files.writers.points import write_ply

    moved = moved_scan(scan, T_target_source)
    columns = {} if moved.strength is None else {"intensity": moved.strength}
    if moved.viewpoints is not None:
        columns |= {f"vp_{axis}": moved.viewpoints[:, k] for k, axis in enumerate("xyz")}
    write_ply(path, moved.points, columns)


def moved_scan(scan: "Scan", T_target_source: "RigidTransform") -> "Scan":
    """The scan with points and viewpoints [m] in the target's frame, without its prior, which was of its own frame."""
    points, viewpoints = (
        None if places is None else T_target_source.apply(places.astype(float)).astype(places.dtype)
        for places in (scan.points, scan.viewpoints)
    )
    # pyrefly: ignore[bad-argument-type]
    return replace(scan, points=points, viewpoints=viewpoints, prior=None)


def _as_json(registration: "Registration", method: ConfiguredMethod, written: Path | None = None) -> dict[str, object]:
    """The registration as JSON; null for values that the method lacks, as a peak or a grid."""
    return _hypothesis(registration) | {
        "accepted": registration.accepted,
        "seconds": registration.seconds,
        "reason": registration.reason,
        "step_psr": registration.step_psr,
        "alternatives": [_hypothesis(other) for other in registration.alternatives],
        "method": method.name,
        "grid": method.edge,
        "voxel": method.grid.voxel,
        **({} if written is None else {"written": written}),
    }


def _hypothesis(registration: "Registration") -> dict[str, object]:
    """The JSON that registrations and their alternatives have in common."""
    return {
        "T_target_source": registration.T_target_source.as_matrix(),
        "covariance": registration.covariance,
        "probability": registration.probability,
        "psr": registration.psr,
        "overlap": registration.overlap,
    }


def print_registration(registration: "Registration", method: ConfiguredMethod) -> None:
    """Print the verdict, the transform as a matrix and in numbers, its standard deviations, and the evidence."""
    typer.echo(_verdict(registration))
    console = result_console()
    console.print("T_target_source, p_target = T p_source \\[m]:")
    for row in registration.T_target_source.as_matrix().tolist():
        console.print("".join(f"{value + 0.0:13.6f}" for value in row))
    console.print()
    print_rows(_rows(registration, method))


def _verdict(registration: "Registration") -> str:
    probability = registration.probability
    known = f"right with a probability of {probability:.1%}" if math.isfinite(probability) else ""
    if registration.accepted:
        return f"Registered: this transform is {known or 'reliable'}."
    return "NO RELIABLE REGISTRATION; do not use this transform" + (f" ({known})" if known else "")


def _rows(registration: "Registration", method: ConfiguredMethod) -> dict[str, str]:
    """The evidence for and against the transform, by name."""
    from sonarmap.slam.graph.tangent import worst_sigmas

    T, (rotation, translation) = registration.T_target_source, worst_sigmas(registration.covariance)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # gimbal lock: with pitch ±90° yaw and roll are one rotation
        yaw, pitch, roll = T.rotation.as_euler("ZYX", degrees=True).tolist()
    x, y, z = T.translation.tolist()
    cube = f"{method.edge} x {method.edge} x {method.edge} " if method.edge else ""
    return {
        "because": as_options(registration.reason),
        "shift": f"x {x:.3f} m forward, y {y:.3f} m left, z {z:.3f} m up, from the target's sensor to the source's",
        "turn": f"yaw {yaw:.2f}° left, pitch {pitch:.2f}° nose down, roll {roll:.2f}° right side down",
        **_others(registration),
        "sigmas": f"{translation:.3f} m and {math.degrees(rotation):.2f}° in the worst direction",
        "overlap": f"{registration.overlap:.0%} of the points lie close to a point of the other scan",
        "method": f"{method.name}, {cube}voxels of {method.grid.voxel:.3g} m",
        "time": f"{registration.seconds:.2f} s, not counting reading and preparing the scans",
    }


def _others(registration: "Registration") -> dict[str, str]:
    """A row about other possible transforms; none if the method does not estimate probabilities."""
    count = len(registration.alternatives)
    if not math.isfinite(registration.probability) or not (count or registration.accepted):
        return {}
    others = f"{counted(count, 'transform')} could not be excluded; --json lists them"
    return {"others": others if count else "every other transform could be excluded"}
