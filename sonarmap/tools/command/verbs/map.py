"""`sonarmap map`: scans in, a map out."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import as_options, print_failure, when_stopped
from sonarmap.tools.command.mapped import (
    Mapped,
    print_mapped,
    print_summary,
    warn_of_faults,
    warn_of_some,
)
from sonarmap.tools.command.method import (
    ConfiguredMethod,
    MethodOptions,
    configure_method,
    require_effect,
    require_method,
)
from sonarmap.tools.command.navigation import (
    ContradictedError,
    ImuOption,
    NavigationReading,
    OdometryFile,
    PriorsFile,
    refusing,
    scans_with_priors,
)
from sonarmap.tools.command.option import NAVIGATION, JsonOption, QuietOption, given, refuse_without
from sonarmap.tools.command.output import EarthPlace, MapOutput, export_with_progress
from sonarmap.tools.command.survey import (
    ExecutionOptions,
    InputsArgument,
    PointReading,
    SurveyOptions,
    TiesAndControl,
    give_back,
    navigated_lines,
    open_execution,
    without_biases,
)
from sonarmap.tools.command.terminal import growing_progress, say, stage, warn
from sonarmap.tools.files.writers.atomic import locked, require_writable

if TYPE_CHECKING:
    from sonarmap.slam.graph.control import ControlPoint
    from sonarmap.slam.motion.odometry import Odometry
    from sonarmap.slam.motion.turn_rates import TurnRates
    from sonarmap.slam.pair import RegisteredPair
    from sonarmap.slam.tie import Tie
    from sonarmap.tools.files.geo import Georeference
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
    from sonarmap.tools.files.readers.pings.line_file import LineReading
    from sonarmap.tools.files.readers.scans import Corrections, ReadScans
    from sonarmap.tools.products.export.run import ExportSettings
    from sonarmap.tools.products.output.trial import MeasuredScans

INCOMPLETE = 3


@dataclass(frozen=True, slots=True)
class SurveyInput:
    """The inputs of a map, with the method and settings."""

    read: "ReadScans"  # with the scans' priors
    odometry: "Odometry | None"
    ties: "tuple[Tie, ...]"
    control: "tuple[ControlPoint, ...]"
    georeference: "Georeference | None"  # of the map; None if it is not known
    method: ConfiguredMethod
    settings: Mapping[str, Any]  # for summary.json
    measured: "MeasuredScans"  # the scans with their priors
    found: list[str]  # what is wrong with the instruments by the files, in words
    vet: "Callable[[Sequence[RegisteredPair]], None] | None"  # may refuse the navigation
    lines: "LineReading"  # how lines of pings became scans
    turn_rates: "TurnRates | None"  # of the recordings' own IMU

    @property
    def files(self) -> list[Path]:
        """All files that are read: scans, navigation, ties and control points."""
        values = [self.settings[name] for name in ("priors", "odometry", "ties", "control") if name in self.settings]
        others = [Path(path) for value in values for path in (value if isinstance(value, list) else [value])]
        return [*self.read.files, *others]


@dataclass(frozen=True, slots=True)
class Reporting:
    """How a run prints its progress and results."""

    start: float  # by the monotonic clock [s]
    as_json: bool
    quiet: bool

    @property
    def silent(self) -> bool:
        """Whether only results, warnings and errors are printed."""
        return self.quiet or self.as_json


def command(
    inputs: InputsArgument,
    output: MapOutput,
    method: MethodOptions,
    priors: PriorsFile,
    points: PointReading,
    odometry: OdometryFile,
    reading: NavigationReading,
    survey: SurveyOptions,
    person: TiesAndControl,
    earth: EarthPlace,
    execution: ExecutionOptions,
    imu: ImuOption = True,
    check_priors: bool = NAVIGATION.flag(
        "--check-priors/--no-check-priors",
        "Stop if the scans contradict the navigation, for example by swapped columns.",
        True,
        rare=True,
    ),
    patch_test: bool = NAVIGATION.flag(
        "--patch-test/--no-patch-test",
        "Estimate latency and mounting-angle biases from overlapping lines, and correct for them.",
        rare=True,
    ),
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make a map from scans: register pairs, close loops, optimize poses, fuse points.

    OUT gets map.ply, map.png, trajectory.tum, graph.g2o, graph.json, pairs.csv, summary.json and report.html, which
    `sonarmap view OUT` opens: the map in 3D, with its loops and uncertainty.
    The scans of each folder are one survey. Surveys of the same place are joined by matching scans; each also gets a
    map of its own, map_survey_0.ply and so on. False echoes, which only one scan saw and others contradict, are only in
    map_all.ply.

    If the registration of a pair fails, mapping continues. Scans that cannot be joined to the rest become separate
    parts: map_2.ply, trajectory_2.tum and so on. The exit code is 3 if there is more than one part, if a scan was
    skipped because it could not be read, if a pair failed by an error of the method rather than by its scans, or if the
    scans contradict the priors as a whole. Files of an earlier run in OUT are replaced only at the end.

    Every finished pair is stored in OUT/journal.sqlite: the same command continues a run that was stopped, and if scans
    were added it registers only the new pairs. times.json has the run's times.

    --export also writes the map for other programs. `sonarmap export` does so later, without another run of `map`.
    """
    from sonarmap.tools.files.readers.navigation.odometry import turn_rates_of
    from sonarmap.tools.files.readers.pings.line_file import way_within
    from sonarmap.tools.products.output.trial import MeasuredScans

    reporting = Reporting(time.monotonic(), as_json, quiet)
    mapper, method = survey.mapper_settings(method)
    require_effect(method, bool(priors.priors))
    files = given(priors) | given(odometry) | given(person)
    _require_files(files)
    check_options(output, method, earth, files)
    navigation = reading.settings(*priors.priors, odometry.odometry, origin=earth.georeference())
    navigation = replace(navigation, fastest=mapper.limits.speed)
    corrections = points.corrections()
    if patch_test:
        corrections = without_biases(inputs, corrections, reporting.silent)
    read, found = _read_scans(inputs, priors.priors, corrections, output.out, reporting.silent)
    navigated = _navigate(read, priors, navigation, imu and method.uses_priors, earth.origin_heading)
    read, georeference = replace(read, scans=navigated.scans), navigated.georeference
    ties = person.read_ties(read.scans)
    control, georeference = person.read_control(read.scans, georeference)
    exports = output.export_settings(earth.crs, georeference, [scan.stamp for scan in read.scans])
    reckoned = odometry.read(read.scans, navigation) or way_within(read.scans, read.patches)
    configured = configure_method(read.scans, method, survey=True)
    described = files | given(reading) | given(points)
    settings = {"inputs": inputs, **described, **configured.settings, "mapper": mapper}
    if not all(patch.below_water for patch in read.patches.values()):
        settings["heights_from"] = "the transducer"
    if patch_test:
        settings["patch_test"] = corrections.lines.biases.to_json()
    rates = turn_rates_of(read.files, read.scans) if imu and mapper.straighten else None
    measured = MeasuredScans(read.scans, priors.named, georeference, corrections.frame.axes)
    vet = refusing(measured) if check_priors else None
    survey_input = SurveyInput(
        read, reckoned, ties, control, georeference, configured, settings, measured, [*found, *navigated.faults], vet,
        corrections.lines, rates,
    )  # fmt: skip
    try:
        whole = _map_and_report(survey_input, execution, output, exports, reporting)
    except ContradictedError as error:
        say(f"{error}. No map was made; --no-check-priors makes one all the same.", "error: ", "bold red")
        print_failure(str(error), INCOMPLETE, as_json)
        raise typer.Exit(INCOMPLETE) from None
    if not whole:
        raise typer.Exit(INCOMPLETE)


def check_options(
    output: MapOutput,
    method: MethodOptions,
    earth: EarthPlace,
    files: Mapping[str, Any],
    stamps: Sequence[float] = (),
    later: bool = True,
) -> None:
    """Refuse impossible options before scans are read or received. `files` are the options of files that were given;
    `stamps` and `later` are those of `MapOutput.export_settings`."""
    needs = {
        "prior_sigmas": "priors",
        "correct_priors": "priors",
        "odometry_drift": "odometry",
        "control_crs": "control",
    }
    for option, needed in needs.items():
        if needed not in files:
            refuse_without(f"--{needed}", {f"--{option.replace('_', '-')}": files.get(option)})
    require_method(method)
    output.export_settings(earth.crs, earth.georeference(), stamps, later)
    require_writable(output.out, make=False)


def _require_files(files: Mapping[str, Any]) -> None:
    for name in ("priors", "odometry", "ties", "control"):
        values = files.get(name, [])
        for value in values if isinstance(values, list) else [values]:
            if not Path(value.partition("::")[0]).exists():
                raise InputError(f"--{name}: cannot read {value}: there is no such file; check its name")


def _map_and_report(
    survey: SurveyInput, execution: ExecutionOptions, output: MapOutput, exports: "ExportSettings", reporting: Reporting
) -> bool:
    """Make and write the map with its report and exports, and print the results; return whether the map is whole."""
    require_writable(output.out)
    with locked(output.out, writing=True):  # until its last file is written
        mapped = _map(survey, execution, output, reporting.silent)
        try:
            if survey.read.patches and survey.georeference is not None:
                give_back(mapped, survey.read.patches, survey.georeference, survey.lines, exports.crs, reporting.silent)
            _write_report_and_exports(mapped, output.report, exports, reporting.silent)
        finally:  # the map exists, even if its report or export failed
            if not reporting.as_json:
                print_mapped(mapped, time.monotonic() - reporting.start)
    if reporting.as_json:
        print_summary(output.out)
        warn_of_faults(mapped)
    return mapped.whole


def _read_scans(
    inputs: list[str], priors: list[Path], corrections: "Corrections", out: Path, quiet: bool
) -> "tuple[ReadScans, list[str]]":
    """Read the scans. Return them and the faults of the sonar; both unreadable scans and faults are warnings."""
    from sonarmap.tools.files.map_folder.names import require_apart
    from sonarmap.tools.files.readers.scans import read_survey
    from sonarmap.tools.products.output.trial import Evidence, ScansOnTrial, on_trial

    with growing_progress("reading", quiet) as step:
        read = read_survey(inputs, priors, step, corrections)
    for note in read.notes:
        say(note)
    if read.unread and len(read.scans) < 2:
        count = f"{len(read.scans)} of {len(read.scans) + len(read.unread)} scans can be read"
        raise InputError(f"{read.unread[0].reason} ({count}; a map needs at least two)")
    warn_of_some([f"skipped, which leaves a gap: {as_options(unread.reason)}" for unread in read.unread])
    require_apart(out, read.files)
    trial = ScansOnTrial()
    for scan, survey in () if read.patches else zip(read.scans, read.surveys, strict=True):
        trial.add(scan, scan.stamp, survey)
    found = [each.words for each in on_trial(Evidence(trial, len(read.unread)))]
    for words in found:
        if not any(note.endswith(words) for note in read.notes):
            warn(words)
    return read, [*read.faults, *found]


def _navigate(
    read: "ReadScans", priors: PriorsFile, navigation: "NavigationSettings", use_imu: bool, heading: float | None
) -> "Navigated":
    """The scans with their priors, and the map's place on the Earth by the navigation."""
    if read.patches and use_imu:
        navigated = navigated_lines(read, priors, navigation)
    else:
        navigated = scans_with_priors(read.scans, priors, navigation, use_imu, bool(read.unread))
    if heading is not None and any(scan.prior is not None and scan.prior.knows_heading for scan in navigated.scans):
        raise InputError("--origin-heading: the priors have headings, which say where the map points; leave it out")
    return navigated


def _map(survey: SurveyInput, options: ExecutionOptions, output: MapOutput, quiet: bool) -> Mapped:
    """Map the survey, and write its folder."""
    from sonarmap.slam.execute.worker import prepared_limit
    from sonarmap.slam.mapper import Mapper
    from sonarmap.tools.files.map_folder.names import JOURNAL
    from sonarmap.tools.files.user_file import input_rows
    from sonarmap.tools.products.output.folder import SurveyRun, survey_times, write_survey
    from sonarmap.tools.products.output.upside_down import map_clouds

    read, method, settings, out = survey.read, survey.method, survey.settings, output.out
    prepared = prepared_limit(method.registrar, options.processes)
    inputs = input_rows(survey.files)  # before mapping, as the files may change meanwhile
    with open_execution(method, prepared, options, out / JOURNAL, quiet) as execution:
        mapper = Mapper(method.registrar, method.grid.voxel, settings["mapper"], execution)
        with growing_progress("mapping", quiet) as step:
            step(0, len(read.scans), "preparing the first scans")
            result = mapper.run(
                read.scans,
                step,
                read.surveys,
                survey.odometry,
                survey.ties,
                survey.control,
                survey.vet,
                survey.turn_rates,
            )
        made = result
        mistake = survey.measured.mistake(result, None if survey.vet is None else lambda: map_clouds(made))
        result = result if mistake is None else replace(result, mistake=mistake.words)
        times = survey_times(execution.timings, options.processes)
        names = [scan.name for scan in read.scans]
        run = SurveyRun(names, settings, method.device, read.unread, inputs, survey.georeference, times, survey.found)
        with stage("writing", quiet):
            write_survey(out, result, run)
    return Mapped(result, names, out, len(read.unread), survey.georeference is not None)


def _write_report_and_exports(mapped: Mapped, report: bool, exports: "ExportSettings", quiet: bool) -> None:
    """Write the report and the exports of a finished map."""
    from sonarmap.tools.files.map_folder.folder import read_map_folder
    from sonarmap.tools.products.report.page import write_report

    out = mapped.out
    with when_stopped(lambda: f"the map is in {out}, but its report and exports are not complete"):
        if report:
            with stage("report", quiet):
                write_report(read_map_folder(out))
        if exports.formats:
            export_with_progress(read_map_folder(out), out, exports, quiet)
