"""The options with which a person takes part in a map: --ties and --control."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.options.groups import EARTH, LOOPS
from sonarmap.tools.command.terminal import say

if TYPE_CHECKING:
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.tie import Tie
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.files.geo.georeference import Georeference

TiesOption = Annotated[
    Path | None,
    typer.Option(
        "--ties",
        metavar="FILE",
        help="Accept, reject or add pairs of scans, by a CSV. Its columns are target, source and verdict "
        "(docs/ties.md). What is registered already is not registered again.",
        rich_help_panel=LOOPS,
    ),
]
ControlOption = Annotated[
    Path | None,
    typer.Option(
        "--control",
        metavar="FILE",
        help="Hold points to known coordinates, by a CSV. Its columns are name, scan, x_m, y_m, z_m and "
        "east_m, north_m, up_m or others (docs/ties.md).",
        rich_help_panel=EARTH,
    ),
]
ControlCrsOption = Annotated[
    str | None,
    typer.Option(
        "--control-crs",
        metavar="CRS",
        help="Of its easting_m and northing_m, as EPSG:25832.",
        rich_help_panel=EARTH,
        hidden=True,
    ),
]
_NAMES = ("ties", "control", "control_crs")


@dataclass(frozen=True, slots=True)
class Hand:
    """What a person says of a survey.

    Attributes:
        ties: of pairs.
        control: points with known coordinates.
        georeference: where the map lies on the Earth, as far as it is known now.
    """

    ties: "tuple[Tie, ...]"
    control: "tuple[ControlPoint, ...]"
    georeference: "Georeference | None"


def hand_of(options: Mapping[str, Any], scans: "Sequence[Scan]", georeference: "Georeference | None") -> Hand:
    """What --ties and --control say; a note for what a user should know of the files.

    Args:
        options: of the verb, by their parameters' names.
        scans: that were read.
        georeference: of the map so far.

    Raises:
        InputError: a file cannot be used, or --control-crs has no file.
    """
    from sonarmap.tools.files.readers.control import read_control
    from sonarmap.tools.files.readers.ties import read_ties

    ties = () if options["ties"] is None else read_ties(options["ties"], scans)
    if options["control"] is None:
        if options["control_crs"] is not None:
            raise InputError("--control-crs has no effect without --control; give it too, or leave it out")
        return Hand(ties, (), georeference)
    read = read_control(options["control"], scans, georeference, options["control_crs"])
    for note in read.notes:
        say(note)
    return Hand(ties, read.points, read.georeference)


def hand_summary(options: Mapping[str, Any]) -> dict[str, Any]:
    """What was given, for the summary, so that the same command can be given again."""
    given = {name: options[name] for name in _NAMES if options.get(name) is not None}
    return {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}
