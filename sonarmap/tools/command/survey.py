"""Options of a survey: its scans, the format of their points, loops, ties and control points, and the processes that
register pairs; lines of pings: their navigation, patch test and output."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import when_stopped
from sonarmap.tools.command.method import ConfiguredMethod, MethodOptions, changed
from sonarmap.tools.command.navigation import PriorsFile
from sonarmap.tools.command.option import (
    EARTH,
    INPUT,
    LOOPS,
    MOST,
    MOST_WORKERS,
    OUTPUT,
    RUNNING,
    checked,
    is_positive,
    refuse_without,
)
from sonarmap.tools.command.terminal import growing_progress, say, stage, warn

if TYPE_CHECKING:
    from sonarmap.slam.execute.executor import Executor
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.slam.execute.worker import PairWorker
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.mapper_settings import MapperSettings
    from sonarmap.slam.pings.calibration import PatchTest
    from sonarmap.slam.pings.crossings import Crossings
    from sonarmap.slam.tie import Tie
    from sonarmap.spectral.scan import Scan
    from sonarmap.tools.command.mapped import Mapped
    from sonarmap.tools.files.geo import Georeference
    from sonarmap.tools.files.readers.clouds.cloud import PingPatch
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
    from sonarmap.tools.files.readers.pings.line_file import LineReading
    from sonarmap.tools.files.readers.scans import Corrections, ReadScans
    from sonarmap.tools.products.output.lines import MovedLine

_limit = partial(
    LOOPS.option,
    rare=True,
    callback=checked(is_positive, "{}; give a number above 0, or leave it out if it is not known"),
    shown="learned",
)


@dataclass(frozen=True, slots=True)
class SurveyOptions:
    """Options of loops, of the vehicle's speed and of the map's voxels."""

    loops: int | None = LOOPS.option(
        "N",
        "Loops to try per scan and round; 0 is none. There are two rounds, and more as long as they improve the poses.",
        shown="2",
        min=0,
        max=MOST,
    )
    max_speed: float | None = _limit(
        "M/S", "How fast the vehicle moves at most \\[m/s]; for scans whose stamps are times."
    )
    max_turn_rate: float | None = _limit(
        "DEG/S", "How fast it turns at most \\[deg/s]; for scans whose stamps are times."
    )
    map_voxel: float | None = OUTPUT.length(
        "Edge of the map's voxels \\[m], finer or coarser than those of registration.",
        "--voxel",
        rare=True,
    )

    def mapper_settings(self, method: MethodOptions) -> "tuple[MapperSettings, MethodOptions]":
        """The mapper's settings, --set included, and the options of the method without the fields of --set that are the
        mapper's."""
        from sonarmap.slam.candidates.settings import LoopSettings
        from sonarmap.slam.mapper_settings import MapperSettings
        from sonarmap.slam.motion.limits import MotionLimits

        settings = MapperSettings(
            LoopSettings() if self.loops is None else LoopSettings(per_scan=self.loops),
            MotionLimits(self.max_speed or math.inf, math.radians(self.max_turn_rate or math.inf)),
            map_voxel=self.map_voxel,
        )
        names = {each.name for each in fields(MapperSettings)}
        of_mapper = [text for text in method.settings if text.partition("=")[0].partition(".")[0].strip() in names]
        others = [text for text in method.settings if text not in of_mapper]
        return changed(settings, of_mapper), replace(method, settings=others)


@dataclass(frozen=True, slots=True)
class TiesAndControl:
    """Options of manual ties and of control points."""

    ties: Path | None = LOOPS.option(
        "FILE", "CSV with pairs of scans to accept, reject or add: target, source, verdict (docs/ties.md)."
    )
    control: Path | None = EARTH.option(
        "FILE",
        "CSV with points of known coordinates: name, scan, x_m, y_m, z_m and east_m, north_m, up_m or others "
        "(docs/ties.md).",
    )
    control_crs: str | None = EARTH.option("CRS", "CRS of the control file's coordinates, e.g. EPSG:25832.", rare=True)

    def read_ties(self, scans: "Sequence[Scan]") -> "tuple[Tie, ...]":
        """The ties of --ties; none without it."""
        from sonarmap.tools.files.readers.constraints import read_ties

        return () if self.ties is None else read_ties(self.ties, scans)

    def read_control(
        self, scans: "Sequence[Scan]", georeference: "Georeference | None"
    ) -> "tuple[tuple[ControlPoint, ...], Georeference | None]":
        """The points of --control, and the map's place on the Earth, which they may give; until now `georeference`."""
        from sonarmap.tools.files.readers.constraints import read_control

        if self.control is None:
            refuse_without("--control", {"--control-crs": self.control_crs})
            return (), georeference
        read = read_control(self.control, scans, georeference, self.control_crs)
        for note in read.notes:
            say(note)
        return read.points, read.georeference


InputsArgument = Annotated[
    list[str],
    typer.Argument(
        help="Scans: files, folders, patterns, topics of bags. They are taken in natural order, scan2 "
        "before scan10; FILE::TOPIC is a topic of a ROS bag or MCAP file, recording.sonar#3 a scan of several.",
        metavar="INPUT...",
    ),
]


@dataclass(frozen=True, slots=True)
class PointReading:
    """Options that describe the points in files."""

    sound_speed: float | None = INPUT.option(
        "M/S", "Correct speed of sound \\[m/s], for .sonar files: ranges are scaled from the recorded one."
    )
    range_scale: float | None = INPUT.option("F", "Multiply all ranges by F, in any format.", rare=True, shown="1")
    frame: str | None = INPUT.option(
        "NAME",
        "Directions of x, y, z of the points in the files, a letter each, such as flu (forward, left, up), frd, rdf "
        "(cameras), fru (left-handed), or ned (North, East, Down, for scans that were leveled and turned North).",
        shown="as the file says, or flu",
    )
    units: str | None = INPUT.option(
        "NAME",
        "Unit of the points in the files: m, cm, mm, ft or us-ft.",
        shown="m",
    )
    min_range: float | None = INPUT.option(
        "M", "Leave out points at this distance from the sensor or nearer \\[m]: no returns.", shown="0.05", min=0
    )
    max_range: float | None = INPUT.option("M", "Leave out points farther from the sensor than this \\[m].")
    exclude_box: list[str] = INPUT.option(
        "BOX",
        "Leave out points in a box in the sensor's frame, such as of a skid: two corners \\[m; forward, left, up], as "
        "in 0.7,-0.4,-0.3,1.2,0.4,0.1. It can be given several times.",
        [],
        shown="none",
    )
    patch: float | None = INPUT.option(
        "M",
        "Length of the patches into which lines of an echo sounder are cut \\[m].",
        shown="half the swath's width",
        rare=True,
    )
    draught: float | None = INPUT.option(
        "M",
        "Depth of the echo sounder's transducer \\[m], for files that do not have it, as many XTF files.",
        shown="0",
        rare=True,
    )
    all_soundings: bool | None = INPUT.flag(
        "--all-soundings", "Keep soundings that lines of an echo sounder flag as rejected.", None, rare=True
    )
    heights: str | None = INPUT.option(
        "NAME",
        "Vertical reference of heights of an echo sounder's lines: surface (the water's) or ellipsoid (.kmall).",
        shown="surface",
        rare=True,
    )

    def corrections(self) -> "Corrections":
        """Corrections of points when files are read."""
        from sonarmap.slam.pings.biases import Biases
        from sonarmap.tools.files.geo import DEFAULT_VERTICAL
        from sonarmap.tools.files.readers.clouds.cloud import Bounds
        from sonarmap.tools.files.readers.pings.line_file import LineReading
        from sonarmap.tools.files.readers.scans import Corrections, PointFrame

        scale = 1.0 if self.range_scale is None else self.range_scale
        frame = PointFrame(self.frame, self.units)
        heights = DEFAULT_VERTICAL if self.heights is None else self.heights
        lines = LineReading(self.patch, Biases(), self.draught or 0.0, bool(self.all_soundings), heights)
        bounds = Bounds.of(self.min_range, self.max_range, self.exclude_box)
        return Corrections(self.sound_speed, scale, frame, lines, bounds)


@dataclass(frozen=True, slots=True)
class ExecutionOptions:
    """Options of the processes that register pairs, and of their journal."""

    workers: int | None = RUNNING.option(
        "N", "Processes that register pairs; the results are the same.", shown="1", min=1, max=MOST_WORKERS
    )
    fresh: bool = RUNNING.flag("--fresh", "Discard the pairs of earlier runs in OUT/journal.sqlite.")

    @property
    def processes(self) -> int:
        """Number of processes that register pairs; 1 is this process alone."""
        return self.workers or 1


@contextmanager
def open_execution(
    method: ConfiguredMethod, prepared: int, options: ExecutionOptions, journal: Path, quiet: bool
) -> Iterator["Execution"]:
    """Open the journal and start the workers of the options for the block. Each worker keeps up to `prepared` prepared
    scans. Unless `quiet`, print how many pairs came from the journal."""
    from sonarmap.slam.execute.journal import Journal
    from sonarmap.slam.execute.runner import Execution
    from sonarmap.tools.methods.fingerprint import method_key

    key = method_key(method.name, method.setup, method.registrar)
    with (
        Journal(journal, options.fresh) as opened,
        _workers(method, prepared, options) as (worker, executor),
    ):
        held = opened.count()
        execution = Execution(worker, executor, opened, key)
        with when_stopped(lambda: _kept(len(execution.timings.pairs), journal, options.fresh)):
            yield execution
        from_journal, tried = execution.timings.from_journal, len(execution.timings.pairs)
        damaged = opened.damaged
    if damaged:
        warn(f"{damaged} results in {journal} were damaged, and have been computed again")
    if from_journal and held and not quiet:
        say(f"{from_journal} of {tried} pairs were in {journal}")
    elif held and not quiet:
        say(f"{journal} holds {held} results of other scans, settings or code; none could be used")


def _kept(pairs: int, journal: Path, fresh: bool) -> str:
    if not pairs:
        return "no pair was done yet, and nothing was written"
    done = "1 pair is done" if pairs == 1 else f"{pairs} pairs are done"
    without = " without --fresh" if fresh else ""
    return f"{done} and kept in {journal}; the same command{without} continues from there"


@contextmanager
def _workers(
    method: ConfiguredMethod, prepared: int, options: ExecutionOptions
) -> "Iterator[tuple[PairWorker, Executor]]":
    from sonarmap.slam.execute.executor import Executor
    from sonarmap.slam.execute.processes import spawned
    from sonarmap.slam.execute.worker import Worker
    from sonarmap.tools.methods.fingerprint import worker_spec

    if options.processes > 1:
        spec = worker_spec(method.name, method.setup, method.registrar, prepared)
        with spawned(options.processes) as pool:
            yield spec, Executor(pool, options.processes)
    else:
        yield Worker(method.registrar, prepared), Executor()


def without_biases(inputs: Sequence[str], corrections: "Corrections", quiet: bool) -> "Corrections":
    """The corrections, with the biases that a patch test of the inputs' lines estimates."""
    from sonarmap.slam.pings.calibration import estimate_biases
    from sonarmap.tools.files.readers.pings.line_file import FORMATS, read_line
    from sonarmap.tools.files.readers.selection import select_files

    files = [each.path for each in select_files(inputs, FORMATS).files if each.path.suffix.lower() in FORMATS]
    if len(files) < 2:
        raise InputError(f"--patch-test needs two lines of pings that overlap, and {len(files)} given; leave it out")
    with growing_progress("patch test", quiet) as step:
        lines = []
        for number, path in enumerate(files):
            step(number, len(files) + 1, path.name)
            lines.append(read_line(path, [], corrections.lines))
        here = lines[0].origin()
        step(len(files), len(files) + 1, "comparing the lines")
        test = estimate_biases([line.placed(here) for line in lines])
    say(f"patch test: {test_words(test)}; the estimated biases are corrected")
    if not test.observable:
        raise InputError("--patch-test: the overlaps of the lines show no bias; leave it out, or add lines")
    return replace(corrections, lines=replace(corrections.lines, biases=test.usable))


def navigated_lines(read: "ReadScans", file: PriorsFile, settings: "NavigationSettings") -> "Navigated":
    """The scans with priors from the navigation of their lines."""
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.pings.line_file import placed

    if file.priors:
        raise InputError(f"multibeam lines contain their own navigation; leave --priors {file.named} out")
    navigated = Navigated(*placed(read.scans, read.patches, settings.origin, file.sigmas))
    say(f"{len(read.patches):,} of {len(read.scans):,} scans are patches of lines, placed by the lines' navigation")
    return navigated


def give_back(
    mapped: "Mapped",
    patches: "Mapping[int, PingPatch]",
    georeference: "Georeference",
    reading: "LineReading",
    crs: str | None,
    quiet: bool,
) -> None:
    """Write the lines as the map corrects them: navigation, soundings, their agreement, and a patch test."""
    from sonarmap.slam.pings.calibration import estimate_biases
    from sonarmap.slam.pings.crossings import crossings
    from sonarmap.tools.products.output.lines import moved_lines, write_lines

    with stage("lines", quiet):
        lines = moved_lines(patches, mapped.result, georeference, reading)
        if not lines:
            return
        before, after = crossings([line.before for line in lines]), crossings([line.after for line in lines])
        test = None
        with suppress(InputError):  # raised for one line, or lines that hardly overlap
            test = estimate_biases([line.before for line in lines])
        write_lines(mapped.out, lines, georeference, crs, (before, after), test)
    mapped.of_lines.extend(_rows(lines, before, after, test))


def _rows(
    lines: "Sequence[MovedLine]", before: "Crossings", after: "Crossings", test: "PatchTest | None"
) -> list[tuple[str, str]]:
    """Rows about the lines in the summary of `map`."""
    import numpy as np

    far = np.concatenate([np.linalg.norm(line.shifts, axis=1) for line in lines])
    of_lines = counted(len(lines), "line")
    pings, soundings = len(far), sum(len(line.after.pings) for line in lines)
    rows = [
        ("lines", f"{of_lines}, {pings:,} pings, {soundings:,} soundings; moved by {np.median(far):.2f} m, the median")
    ]
    if before.all.count:
        agreed = f"{after.all.p95:.2g} m ({before.all.p95:.2g} m as recorded)"
        rows.append(("overlaps", f"95 % of {before.cells:,} cells agree within {agreed}, means of soundings"))
    if test is not None:
        rows.append(("biases", f"{test_words(test)}; --patch-test corrects them"))
    return rows


def test_words(test: "PatchTest") -> str:
    """The biases of a patch test with standard deviations."""
    from sonarmap.slam.pings.biases import NAMES

    values, sigmas = test.biases.to_json(), test.deviations.to_json()
    words: list[str] = []
    for name, key in zip(NAMES, values, strict=True):
        unit = "s" if key.endswith("_s") else "degrees"
        value = f"{values[key]:+.2f} ± {sigmas[key]:.2f} {unit}"
        words.append(f"{name} {value}" if name in test.observable else f"{name} is not observable")
    return ", ".join(words)
