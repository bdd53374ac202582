"""The options of verbs that read scans: which, and how their points are to be understood."""

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.tools.command.options.option import INPUT, completes, listed_in, option

if TYPE_CHECKING:
    from sonarmap.tools.files.readers.corrections import Corrections

_input = partial(option, INPUT)

InputsArgument = Annotated[
    list[str],
    typer.Argument(
        help="Scans: files, folders, patterns, topics of bags. They are taken in natural order, scan2 "
        "before scan10; FILE::TOPIC is a topic of a ROS bag or MCAP file, recording.sonar#3 a scan of several.",
        metavar="INPUT...",
    ),
]


_CORRECTIONS = "sonarmap.tools.files.readers.corrections"


@dataclass(frozen=True, slots=True)
class PointReading:
    """How the points of files are to be understood."""

    sound_speed: float | None = _input(
        "M/S", "The right speed of sound \\[m/s], for .sonar. Ranges are multiplied by its ratio to the recorded one."
    )
    range_scale: float | None = _input("F", "Multiply all ranges by F. This is for any format.", rare=True, shown="1")
    frame: str | None = _input(
        "NAME",
        "Axes: flu, frd, rdf or ned. They are those of the points in the files: flu is forward, left, up; "
        "frd forward, right, down; rdf right, down, forward, as of cameras; ned North, East, Down: scans that were "
        "leveled and turned North.",
        shown="flu",
        autocompletion=completes(listed_in(_CORRECTIONS, "FRAMES")),
    )
    units: str | None = _input(
        "NAME",
        "Lengths: m, cm, mm, ft or us-ft. They are those of the points in the files.",
        shown="m",
        autocompletion=completes(listed_in(_CORRECTIONS, "UNITS")),
    )

    patch: float | None = _input(
        "M",
        "Of lines of pings: length of the patches into which they are cut \\[m].",
        shown="half the swath's width",
        rare=True,
    )
    draught: float | None = _input(
        "M",
        "Of lines of pings: depth of the transducer \\[m]. It is for files that do not say it, as many XTF files.",
        shown="0",
        rare=True,
    )

    def corrections(self) -> "Corrections":
        """What is done to the points of files when they are read.

        Raises InputError: numbers that are no speed of sound in water, no factor or no length, or unknown names.
        """
        from sonarmap.tools.files.readers.corrections import Corrections, PointFrame
        from sonarmap.tools.files.readers.pings.patches import LineReading

        scale = 1.0 if self.range_scale is None else self.range_scale
        frame = PointFrame("flu" if self.frame is None else self.frame, "m" if self.units is None else self.units)
        return Corrections(self.sound_speed, scale, frame, LineReading(self.patch, draught=self.draught or 0.0))
