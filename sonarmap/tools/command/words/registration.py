"""What `sonarmap register` prints of a registration: the verdict, the transform in words, and what speaks for it."""

import math
import warnings
from typing import TYPE_CHECKING

import typer

from sonarmap.kernels.counted import counted
from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.method import ConfiguredMethod
from sonarmap.tools.command.terminal import print_rows, result_console

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from sonarmap.spectral.result import Registration

# for each axis of the target's sensor (x forward, y left, z up) the word for more and for less than 0
_PLACES = (("forward", "back"), ("left", "right"), ("up", "down"))
# and for the turns about z, y and x, all right-handed
_TURNS = (("to the left (yaw)", "to the right (yaw)"), ("nose down (pitch)", "nose up (pitch)"))
_TURNS += (("right side down (roll)", "left side down (roll)"),)
_LEAST_M, _LEAST_DEG = 0.0005, 0.005  # what is less would be printed as 0


def print_registration(registration: "Registration", method: ConfiguredMethod) -> None:
    """The verdict in the first line, the transform, its standard deviations, and the evidence."""
    from rich.text import Text

    typer.echo(_verdict(registration))
    console = result_console()
    console.print(Text(transform_words(registration.T_target_source)))
    console.print()
    console.print("T_target_source, p_target = T p_source \\[m]:")
    for row in registration.T_target_source.as_matrix().tolist():
        console.print("".join(f"{value + 0.0:13.6f}" for value in row))
    console.print()
    print_rows(_rows(registration, method))


def transform_words(T_target_source: "RigidTransform") -> str:
    """Where the source's sensor was, seen from the target's: "3.212 m forward and 0.021 m down" and so on.

    p_target = T p_source [m], both frames x forward, y left, z up.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # where it looks straight up or down, yaw and roll are one turn
        turns = T_target_source.rotation.as_euler("ZYX", degrees=True)
    places = _named(T_target_source.translation.tolist(), _PLACES, "{:.3f} m", _LEAST_M)
    angles = _named(turns.tolist(), _TURNS, "{:.2f}°", _LEAST_DEG)
    whole = math.degrees(float(T_target_source.rotation.magnitude()))
    place = places or "where the target's is"
    turn = f"is turned {angles}, {whole:.2f}° in all" if angles else "looks the same way"
    return f"Seen from the target's sensor, the source's is {place}; it {turn}."


def _named(values: list[float], words: tuple[tuple[str, str], ...], number: str, least: float) -> str:
    """The values with their directions, "3.21 m forward and 0.40 m left"; those that would be printed as 0 left out."""
    named = [
        f"{number.format(abs(value))} {more if value > 0 else less}"
        for value, (more, less) in zip(values, words, strict=True)
        if abs(value) >= least
    ]
    return " and ".join([", ".join(named[:-1]), named[-1]] if len(named) > 1 else named)


def _verdict(registration: "Registration") -> str:
    probability = registration.probability
    known = f"right with a probability of {probability:.1%}" if math.isfinite(probability) else ""
    if registration.accepted:
        return f"Registered: this transform is {known or 'reliable'}."
    return "NO RELIABLE REGISTRATION; do not use this transform" + (f" ({known})" if known else "")


def _rows(registration: "Registration", method: ConfiguredMethod) -> dict[str, str]:
    """What speaks for the transform and against it, by name."""
    from sonarmap.slam.graph.tangent import worst_sigmas

    rotation, translation = worst_sigmas(registration.covariance)
    cube = f"{method.edge} x {method.edge} x {method.edge} " if method.edge else ""
    return {
        "because": as_options(registration.reason),
        **_others(registration),
        "sigmas": f"{translation:.3f} m and {math.degrees(rotation):.2f}° in the worst direction",
        "overlap": f"{registration.overlap:.0%} of the points lie close to a point of the other scan",
        "method": f"{method.name}, {cube}voxels of {method.grid.voxel:.3g} m",
        "time": f"{registration.seconds:.2f} s, not counting reading and preparing the scans",
    }


def _others(registration: "Registration") -> dict[str, str]:
    """How many other transforms are possible, if the method says so."""
    count = len(registration.alternatives)
    if not math.isfinite(registration.probability) or not (count or registration.accepted):
        return {}
    others = f"{counted(count, 'transform')} could not be excluded; --json lists them"
    return {"others": others if count else "every other transform could be excluded"}
