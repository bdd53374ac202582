"""Options that say how the points of files are to be understood; the same for every verb that reads scans."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.tools.command.options.groups import INPUT, NAVIGATION, completes

if TYPE_CHECKING:
    from sonarmap.tools.files.readers.corrections import Corrections

# parameters of the verbs that change points as they are read
CORRECTIONS = ("sound_speed", "range_scale", "frame", "units")


def _frames(incomplete: str) -> list[str]:
    from sonarmap.tools.files.readers.corrections import FRAMES  # imports SciPy, which the help can do without

    return completes(FRAMES)(incomplete)


def _units(incomplete: str) -> list[str]:
    from sonarmap.tools.files.readers.corrections import UNITS

    return completes(UNITS)(incomplete)


SoundSpeedOption = Annotated[
    float | None,
    typer.Option(
        "--sound-speed",
        metavar="M/S",
        help="The right speed of sound \\[m/s], for .sonar. Ranges are multiplied by its ratio to the recorded one.",
        rich_help_panel=INPUT,
    ),
]
RangeScaleOption = Annotated[
    float | None,
    typer.Option(
        "--range-scale",
        metavar="F",
        help="Multiply all ranges by F. This is for any format.",
        rich_help_panel=INPUT,
        hidden=True,
        show_default="1",
    ),
]
ImuOption = Annotated[
    bool,
    typer.Option(
        "--imu/--no-imu",
        help="Use roll and pitch as the IMU within a recording has them.",
        rich_help_panel=NAVIGATION,
        hidden=True,
    ),
]
FrameOption = Annotated[
    str | None,
    typer.Option(
        "--frame",
        metavar="NAME",
        help="Axes: flu, frd, rdf or ned. They are those of the points in the files: flu is "
        "forward, left, up; frd forward, right, down; "
        "rdf right, down, forward, as of cameras; ned North, East, Down: scans that were leveled and turned North.",
        rich_help_panel=INPUT,
        show_default="flu",
        autocompletion=_frames,
    ),
]
UnitsOption = Annotated[
    str | None,
    typer.Option(
        "--units",
        metavar="NAME",
        help="Lengths: m, cm, mm, ft or us-ft. They are those of the points in the files.",
        rich_help_panel=INPUT,
        show_default="m",
        autocompletion=_units,
    ),
]


def corrections_of(options: Mapping[str, Any]) -> "Corrections":
    """What is done to the points of files when they are read.

    Args:
        options: of the verb, by their parameters' names.

    Raises:
        InputError: numbers that are no speed of sound in water or no factor, or unknown names.
    """
    from sonarmap.tools.files.readers.corrections import Corrections, PointFrame

    given = corrections_summary(options)
    frame = PointFrame(given.get("frame", "flu"), given.get("units", "m"))
    return Corrections(given.get("sound_speed"), given.get("range_scale", 1.0), frame)


def corrections_summary(options: Mapping[str, Any]) -> dict[str, Any]:
    """What was given, for the summary, so that the same command can be given again."""
    return {name: options[name] for name in CORRECTIONS if options.get(name) is not None}
