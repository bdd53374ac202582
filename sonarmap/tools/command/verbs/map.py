"""`sonarmap map`: scans in, a map out."""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.arguments import as_options
from sonarmap.tools.command.execution import ExecutionOptions, open_execution
from sonarmap.tools.command.method import ConfiguredMethod, configure_method, method_options
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
    navigation_summary,
    scans_with_priors,
)
from sonarmap.tools.command.navigation_check import contradiction_of
from sonarmap.tools.command.options.export import ExportOption, export_settings, export_with_progress
from sonarmap.tools.command.options.geo import (
    CrsOption,
    OriginHeadingOption,
    OriginOption,
    VerticalOption,
    georeference_of,
)
from sonarmap.tools.command.options.groups import OUTPUT
from sonarmap.tools.command.options.hand import ControlCrsOption, ControlOption, Hand, TiesOption, hand_of, hand_summary
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
    QuietOption,
    RefineOption,
    SeedOption,
    StrengthOption,
    VoxelOption,
    YawPeaksOption,
)
from sonarmap.tools.command.options.running import VerboseOption
from sonarmap.tools.command.options.scan import (
    FrameOption,
    ImuOption,
    RangeScaleOption,
    SoundSpeedOption,
    UnitsOption,
    corrections_of,
    corrections_summary,
)
from sonarmap.tools.command.options.survey import (
    AlsoOption,
    FreshOption,
    InputsArgument,
    KeyStepOption,
    LoopsOption,
    MaxSpeedOption,
    MaxStepOption,
    MaxTurnRateOption,
    MinSeenOption,
    OdometryDriftOption,
    OdometryOption,
    ReportOption,
    SchedulerOption,
    WorkersOption,
    odometry_of,
    survey_settings,
)
from sonarmap.tools.command.progress import growing_progress, stage
from sonarmap.tools.command.stops import when_stopped
from sonarmap.tools.command.terminal import say, warn
from sonarmap.tools.command.words.survey import (
    Mapped,
    print_mapped,
    print_summary,
    warn_of_faults,
    warn_of_some,
    written_summary,
)
from sonarmap.tools.files.writers.atomic import clear_leftovers, require_writable
from sonarmap.tools.files.writers.folder_lock import locked
from sonarmap.tools.methods.registry import DEFAULT_METHOD

if TYPE_CHECKING:
    from sonarmap.slam.motion.odometry import Odometry
    from sonarmap.slam.survey_result import SurveyResult
    from sonarmap.tools.files.geo.georeference import Georeference
    from sonarmap.tools.files.readers.corrections import Corrections
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
    from sonarmap.tools.files.readers.scans import ReadScans
    from sonarmap.tools.products.export.run import ExportSettings

INCOMPLETE = 3


def command(
    context: typer.Context,
    inputs: InputsArgument,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder for the results.", metavar="OUT", rich_help_panel=OUTPUT)
    ],
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
    odometry: OdometryOption = None,
    odometry_drift: OdometryDriftOption = None,
    nav_columns: NavColumnsOption = None,
    time_scale: TimeScaleOption = None,
    nav_offset: NavOffsetOption = None,
    nav_crs: NavCrsOption = None,
    nav_frame: NavFrameOption = None,
    mount: MountOption = None,
    heading_reference: HeadingReferenceOption = None,
    magnetic_declination: MagneticDeclinationOption = None,
    loops: LoopsOption = None,
    key_step: KeyStepOption = None,
    max_speed: MaxSpeedOption = None,
    max_turn_rate: MaxTurnRateOption = None,
    max_step: MaxStepOption = None,
    min_seen: MinSeenOption = None,
    ties: TiesOption = None,
    control: ControlOption = None,
    control_crs: ControlCrsOption = None,
    report: ReportOption = True,
    also: AlsoOption = [],  # noqa: B006 - typer's way to say none
    export: ExportOption = [],  # noqa: B006
    origin: OriginOption = None,
    origin_heading: OriginHeadingOption = None,
    vertical: VerticalOption = None,
    crs: CrsOption = None,
    device: DeviceOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    fresh: FreshOption = False,
    seed: SeedOption = DEFAULT_SEED,
    as_json: JsonOption = False,
    verbose: VerboseOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make a map from scans: register pairs, close loops, optimize poses, fuse points.

    OUT gets map.ply, map.png, loops.png, profile.png, trajectory.tum, graph.g2o, graph.json, pairs.csv, summary.json
    and report.html, which `sonarmap view OUT` opens: the map in 3D, with its loops and uncertainty.
    The scans of each folder are one survey. Surveys of the same place are joined where their scans look alike; each
    also gets a map of its own, map_survey_0.ply and so on. What one scan alone saw and others contradict, a false
    echo, is in map_all.ply alone.

    Where the registration of a pair fails, mapping goes on. Scans that nothing joins to the rest become a part of their
    own: map_2.ply, trajectory_2.tum and so on. The exit code is 3 if there is more than one part, if a scan could
    not be read and was skipped, or if a pair ended by an error of the method instead of what its scans show. The files
    of an earlier run in OUT are replaced only when everything is done.

    Every finished pair is stored in OUT/journal.sqlite: the same command continues a run that was stopped, and if scans
    were added it registers only the new pairs. times.json says how long the run took.

    --export writes the map for other programs too, as `sonarmap export` does, which needs no other run of `map`.
    """
    start = time.monotonic()
    options, execution_options = method_options(context), ExecutionOptions.of(workers, scheduler, fresh)
    mapping = survey_settings(loops, key_step, max_speed, max_turn_rate, max_step, min_seen)
    given, silent = context.params, quiet or as_json
    navigation = navigation_settings(given, georeference_of(origin, origin_heading, vertical))
    read, georeference = _navigated(given, navigation, imu and options.uses_priors, silent)
    hand = hand_of(given, read.scans, georeference)
    exports = export_settings(export, crs, also, hand.georeference, read.scans, out)
    reckoned = odometry_of(read.scans, odometry, odometry_drift, navigation)
    configured = configure_method(read.scans, options, survey=True)
    if contradiction := contradiction_of(read.scans, read.surveys, configured.registrar, silent):
        warn(f"{contradiction}; correct {priors}, or say how it is meant (docs/navigation.md)")
    described = {**navigation_summary(given), **corrections_summary(given), **hand_summary(given)}
    settings = {"inputs": inputs, **described, **configured.settings, "mapper": mapping}
    require_writable(out)
    with locked(out, writing=True):  # until its last file is written
        result = _map(read, reckoned, configured, execution_options, settings, out, also, hand, silent)
        names, on_earth = [scan.name for scan in read.scans], hand.georeference is not None
        mapped = Mapped(result, names, out, also, len(read.unread), on_earth)
        later: list[str] = []
        try:
            _write_more(out, report, exports, silent, later)
        finally:  # the map is there, whatever its report and export came to
            if not as_json:
                print_mapped(replace(mapped, later=later, seconds=time.monotonic() - start), verbose)
    if as_json:
        print_summary(out)
        warn_of_faults(mapped, verbose)
    if not mapped.whole:
        raise typer.Exit(INCOMPLETE)


def _write_more(out: Path, report: bool, exports: "ExportSettings", quiet: bool, written: list[str]) -> None:
    """Write what is made of the finished map: its report, and the formats of --export; add the names of the files."""
    from sonarmap.tools.files.map_folder.folder import read_map_folder
    from sonarmap.tools.files.map_folder.names import REPORT
    from sonarmap.tools.products.report.page.page import write_report

    written_summary(out)  # a folder that was removed meanwhile is better named so than as the report would
    with when_stopped(lambda: f"the map is in {out}, but not all that is made of it"):
        if report:
            with stage("report", quiet):
                write_report(read_map_folder(out))
            written.append(REPORT)
        if exports.formats:
            exported = export_with_progress(read_map_folder(out), out, exports, quiet)
            written.extend(path.name for path in exported.files)


def _navigated(
    given: Mapping[str, Any], navigation: "NavigationSettings", use_imu: bool, quiet: bool
) -> "tuple[ReadScans, Georeference | None]":
    """The scans with what instruments measured of them, and where the map lies on the Earth, as far as it is known.

    Args:
        given: the verb's options, by their parameters' names.
        navigation: how to understand the file of --priors.
        use_imu: whether recordings' own attitudes count.
        quiet: whether progress is not shown.
    """
    read = _read(given["inputs"], given["priors"], corrections_of(given), given["out"], quiet)
    navigated = scans_with_priors(
        read.scans, given["priors"], given["prior_sigmas"], use_imu, bool(read.unread), navigation, read.files
    )
    read = replace(read, scans=navigated.scans)
    _refuse_second_heading(read, given["origin_heading"])
    return read, navigated.georeference


def _refuse_second_heading(read: "ReadScans", heading: float | None) -> None:
    if heading is not None and any(scan.prior is not None and scan.prior.knows_heading for scan in read.scans):
        raise InputError("--origin-heading: the priors have headings, which say where the map points; leave it out")


def _read(inputs: list[str], priors: Path | None, corrections: "Corrections", out: Path, quiet: bool) -> "ReadScans":
    """The scans that can be read, and a warning for each that cannot."""
    from sonarmap.tools.files.map_folder.names import require_apart
    from sonarmap.tools.files.readers.scans import read_survey

    with growing_progress("reading", quiet) as step:
        read = read_survey(inputs, [priors] if priors else [], step, corrections)
    for note in read.notes:
        say(note)
    if read.unread and len(read.scans) < 2:
        count = f"{len(read.scans)} of {len(read.scans) + len(read.unread)} scans can be read"
        raise InputError(f"{read.unread[0].reason} ({count}; a map needs at least two)")
    warn_of_some([f"skipped, which leaves a gap: {as_options(unread.reason)}" for unread in read.unread])
    warn_of_some(read.repeated)
    require_apart(out, read.files)
    return read


def _map(
    read: "ReadScans",
    odometry: "Odometry | None",
    configured: ConfiguredMethod,
    options: ExecutionOptions,
    settings: Mapping[str, Any],
    out: Path,
    also: list[str],
    hand: Hand,
    quiet: bool,
) -> "SurveyResult":
    """Map the survey, and write its folder."""
    from sonarmap.slam.execute.worker import prepared_limit
    from sonarmap.slam.mapper import Mapper
    from sonarmap.tools.files.inputs import input_rows
    from sonarmap.tools.files.map_folder.names import JOURNAL
    from sonarmap.tools.products.output.folder import write_survey
    from sonarmap.tools.products.output.run import SurveyRun, survey_times

    prepared = prepared_limit(configured.registrar, options.workers)
    names = [scan.name for scan in read.scans]
    instruments = [Path(settings[name]) for name in ("priors", "odometry", "ties", "control") if name in settings]
    inputs = input_rows([*read.files, *instruments])  # now: while the scans are mapped, files may change
    with open_execution(configured, prepared, options, out / JOURNAL, quiet) as execution:
        clear_leftovers(out)  # the folder and its journal are locked: no other run writes here
        mapper = Mapper(configured.registrar, configured.grid.voxel, settings["mapper"], execution)
        with growing_progress("mapping", quiet) as step:
            step(0, len(read.scans), "preparing the first scans")
            result = mapper.run(read.scans, step, read.surveys, odometry, hand.ties, hand.control)
        times = survey_times(execution.timings, options.place)
        run = SurveyRun(names, settings, configured.device, read.unread, inputs, hand.georeference, times)
        with stage("writing", quiet):
            write_survey(out, result, run, also)
    return result
