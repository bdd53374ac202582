"""`sonarmap live`: map while the vehicle dives."""

import sys
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Annotated

import typer

from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.failures import discard
from sonarmap.tools.command.method import MethodOptions, require_effect
from sonarmap.tools.command.navigation import ImuOption, NavigationReading, OdometryFile, PriorsFile
from sonarmap.tools.command.option import INPUT, NAVIGATION, OUTPUT, RUNNING, JsonOption, QuietOption, given
from sonarmap.tools.command.output import EarthPlace, MapOutput
from sonarmap.tools.command.survey import ExecutionOptions, PointReading, SurveyOptions, TiesAndControl
from sonarmap.tools.command.terminal import followed, say, status_line, warn
from sonarmap.tools.command.verbs import map as map_verb
from sonarmap.tools.command.verbs.record import Listening, ending

if TYPE_CHECKING:
    from sonarmap.tools.command.live.chosen import Reading
    from sonarmap.tools.command.live.mapping import MappingSettings
    from sonarmap.tools.command.live.recording import RecordingProcess
    from sonarmap.tools.files.finding import Remedy
    from sonarmap.tools.products.live.server import LivePage

NOTHING_CAME = 3

SourceArgument = Annotated[
    list[str] | None,
    typer.Argument(
        help="A recording (.sonar) or folder of scans that grows; with --replay finished scans, as for `sonarmap map`. "
        "Without SOURCE the data of a Sonar 3D-15 are recorded from the network to OUT/recording, and mapped.",
        metavar="[SOURCE]",
        show_default=False,
    ),
]


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """Options of the dive and of the page that shows it."""

    replay: float | None = INPUT.option(
        "F", "Replay finished scans faster than real time by this factor. 0 is as fast as possible.", min=0.0
    )
    onto: Path | None = INPUT.option("MAP", "Locate the vehicle in a finished map, and show both.")
    nmea: str | None = NAVIGATION.option(
        "PORT|DEVICE",
        "Receive NMEA at a UDP port of this computer, at HOST:PORT (0.0.0.0:10110 also from other computers), or "
        "from a serial device. Sentences are saved to OUT/navigation.nmea and used as --priors.",
    )
    browser: bool = RUNNING.flag("--browser/--no-browser", "Open the page in the browser.", True)
    port: int = RUNNING.option(
        "PORT", "TCP port of the web page.", 0, shown="any that is free", min=0, max=65535, rare=True
    )
    bind: str = RUNNING.option(
        "ADDRESS",
        "Serve the page on this address, 0.0.0.0 for all, so that other computers can open it. Its URL then contains a "
        "token.",
        "127.0.0.1",
        rare=True,
    )
    finish: bool = OUTPUT.flag("--finish/--no-finish", "Make the map as `sonarmap map` does when the dive ends.", True)


def command(
    output: MapOutput,
    listening: Listening,
    live: LiveOptions,
    method: MethodOptions,
    points: PointReading,
    priors: PriorsFile,
    odometry: OdometryFile,
    reading: NavigationReading,
    survey: SurveyOptions,
    earth: EarthPlace,
    source: SourceArgument = None,
    imu: ImuOption = True,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Map while the vehicle dives, and show it in the browser.

    The page shows the growing map, the vehicle's position with its uncertainty, and how often each place was seen; for
    a lost vehicle also its last reliable position. Each scan is placed when it arrives; meanwhile loops are closed and
    all poses optimized again, with the rows that --priors and --odometry have so far. Scans that arrive too fast are
    placed at the end.

    Ctrl-C or --duration ends the dive. Then the map is made as by `sonarmap map`, with the same files and exit codes,
    and the page becomes its report; `sonarmap map OUT/recording -o OUT` with more options makes it again. A separate
    process records data from the network to OUT/recording. If started again with the same OUT, the dive continues.
    """
    from sonarmap.tools.command.live.chosen import Reading
    from sonarmap.tools.command.live.navigation import NAME
    from sonarmap.tools.products.live.server import LivePage

    inputs, out = source or [], output.out
    _require_source(inputs, live.replay)
    if live.nmea is not None and priors.priors:
        raise InputError("--nmea and --priors both give navigation; leave one out")
    known = priors if live.nmea is None else replace(priors, priors=[out / NAME])
    options = _DiveOptions(
        inputs, output, live, method, Reading(known, reading, points), odometry, survey, earth, imu, as_json, quiet
    )
    settings = options.settings()
    require_effect(settings.method, bool(priors.priors))
    stamps = () if inputs else (time.time(),)
    may_be_placed = bool(inputs or known.priors)
    map_verb.check_options(output, method, earth, given(known) | given(odometry), stamps, may_be_placed)
    with LivePage(live.bind, live.port) as page:
        chosen = _follow(options, page, listening)
        _finish(settings, live.finish, page, lambda mapped: options.make_map(mapped, chosen))


@dataclass(frozen=True, slots=True)
class _DiveOptions:
    """The options of a dive, for its mapping and the final map."""

    inputs: list[str]
    output: MapOutput
    live: LiveOptions
    method: MethodOptions
    reading: "Reading"
    odometry: OdometryFile
    survey: SurveyOptions
    earth: EarthPlace
    imu: bool
    as_json: bool
    quiet: bool

    def settings(self, chosen: "Sequence[Remedy]" = ()) -> "MappingSettings":
        """Settings of the mapping with the remedies that were chosen on the page."""
        from sonarmap.tools.command.live.mapping import MappingSettings
        from sonarmap.tools.command.live.navigation import Navigation
        from sonarmap.tools.command.live.recording import FOLDER

        use, out = self.reading.corrected(chosen), self.output.out
        mapper, method = self.survey.mapper_settings(self.method)
        navigation = Navigation(use.priors, self.odometry, use.log, mapper.limits.speed, self.earth.georeference())
        return MappingSettings(
            out,
            tuple(self.inputs) or (str(out / FOLDER),),
            self.live.replay,
            use.points.corrections(),
            method,
            mapper,
            navigation if self.live.onto is None else None,
        )

    def make_map(self, inputs: list[str], chosen: "Sequence[Remedy]") -> None:
        """Make the map of the dive's files as `sonarmap map`, with the remedies that were chosen on the page."""
        use, odometry = self.reading.corrected(chosen), self.odometry
        if self.live.nmea is not None and not _has_navigation(use.priors.priors[0]):
            use = replace(use, priors=PriorsFile(), log=NavigationReading() if odometry.odometry is None else use.log)
        make = lambda output, earth: map_verb.command(  # noqa: E731
            inputs, output, self.method, use.priors, use.points, odometry, use.log, self.survey,
            TiesAndControl(), earth, ExecutionOptions(), imu=self.imu, check_priors=True, patch_test=False,
            as_json=self.as_json, quiet=self.quiet,
        )  # fmt: skip
        _make_map(make, self.output, self.earth, inputs)


def _finish(settings: "MappingSettings", maps: bool, page: "LivePage", finish: Callable[[list[str]], None]) -> None:
    """After a dive, make the map of its files with `finish`, if wanted, and show its report."""
    from sonarmap.tools.command.live.kept_keys import clear
    from sonarmap.tools.files.map_folder.names import REPORT
    from sonarmap.tools.files.readers.incoming import final_path

    mapped = [str(final_path(Path(name))) for name in settings.inputs]
    if not _has_scans(mapped):
        clear(settings.out)
        warn("no scan came, and there is no map")
        raise typer.Exit(NOTHING_CAME)
    if maps:
        with _shown(page, settings.out / REPORT):
            finish(mapped)
        clear(settings.out)


@contextmanager
def _shown(page: "LivePage", report: Path) -> Iterator[None]:
    """Show the progress of the block on the page, and then the report, if one was written."""
    before = report.stat().st_mtime_ns if report.is_file() else None
    try:
        with followed(page.making):
            yield
    finally:  # an incomplete map has a report, too
        if report.is_file() and report.stat().st_mtime_ns != before:
            page.show_report(report.read_text(encoding="utf-8"))


def _make_map(
    make: Callable[[MapOutput, EarthPlace], None], output: MapOutput, earth: EarthPlace, inputs: Sequence[str]
) -> None:
    """Make the map of a dive that has ended, without --export if that needs a place on the Earth that is not known."""
    from sonarmap.tools.products.export.run import NoPlaceError

    try:
        make(output, earth)
    except NoPlaceError as error:
        warn(f"{error}. The map is made without --export; 'sonarmap export {output.out}' writes it for other programs")
        make(replace(output, export=[]), replace(earth, crs=None))
    except InputError as error:
        again = f"sonarmap map {' '.join(inputs)} -o {output.out}"
        raise InputError(f"{error}. The scans are kept; '{again}' with other options makes the map") from error


def _follow(options: _DiveOptions, page: "LivePage", listening: Listening) -> "list[Remedy]":
    """Show a dive until it ends; return the remedies that were chosen on the page. `listening` are the options of the
    recording and its end."""
    from sonarmap.tools.command.live.chosen import kept_chosen
    from sonarmap.tools.command.live.dive import Dive
    from sonarmap.tools.command.live.kept_keys import has_keys, kept_for
    from sonarmap.tools.command.live.navigation import NavigationLog

    settings, live = options.settings(), options.live
    out, onto = settings.out, [] if live.onto is None else [str(live.onto)]
    kept_settings = [settings.corrections, settings.method, settings.mapper]
    with ExitStack() as stack:
        stack.enter_context(kept_for(out, (*settings.inputs, *onto), kept_settings))
        navigation = None if live.nmea is None else stack.enter_context(NavigationLog(live.nmea, out))
        stop = stack.enter_context(ending(listening.seconds))
        if live.onto is not None and not has_keys(out):
            _keep_map(live.onto, out)
        show = stack.enter_context(status_line(options.quiet or options.as_json))
        recording = None if options.inputs else stack.enter_context(_recording(out, listening, stop))
        # if anything fails below, the recording continues
        with suppress(OSError):
            say(f"the map is shown at {' or '.join(page.addresses)}; Ctrl-C ends the dive")
        if live.browser:
            Thread(target=_open_browser, args=(page.address,), daemon=True).start()
        news = [each.said for each in (recording, navigation) if each is not None]
        show_state = lambda state, warnings: show([state.sentence], warnings, state.status)  # noqa: E731
        dive = Dive(options.settings, out, page, show_state, recording is not None, news, kept_chosen(out))
        dive.follow(stop)
    try:
        say(f"the dive has ended{''.join(f'; {remedy} was chosen on the page' for remedy in dive.chosen)}")
    except OSError:  # the terminal was closed; the map is made all the same
        discard(sys.stderr)
    return dive.chosen


@contextmanager
def _recording(out: Path, listening: Listening, stop: Event) -> "Iterator[RecordingProcess]":
    """A recording that runs until `stop` is set. If the block ends before, it continues, and the next `sonarmap live`
    takes it over."""
    from sonarmap.tools.command.live.recording import RecordingProcess, recorder_of
    from sonarmap.tools.command.record.receiver import open_socket

    if recorder_of(out) is None:
        open_socket(listening.source).close()  # a wrong address is refused now
    recording = RecordingProcess(out, listening.as_options())
    keeping = Thread(target=recording.keep_on, args=(stop,), name="recording", daemon=True)
    keeping.start()
    try:
        yield recording
    finally:
        if stop.is_set():
            keeping.join()


def _open_browser(address: str) -> None:
    """Open the page, in a thread, as a browser in the terminal returns only when it is closed."""
    with suppress(webbrowser.Error, OSError):
        webbrowser.open(address)


def _has_scans(inputs: list[str]) -> bool:
    """Whether the inputs have scans."""
    from sonarmap.tools.files.readers.file import FORMATS
    from sonarmap.tools.files.readers.selection import select_files

    try:
        paths = [selected.path for selected in select_files(inputs, FORMATS).files]
        return any(path.is_dir() or path.stat().st_size for path in paths)
    except (InputError, OSError):
        return False


def _has_navigation(log: Path) -> bool:
    """Whether a recorded NMEA log has navigation; if not, print a warning."""
    import numpy as np

    from sonarmap.tools.files.readers.navigation.nmea import read_nmea
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings

    try:
        read_nmea(log, NavigationSettings(), np.array([time.time()]), [])
    except InputError as error:
        warn(f"{error}; the map is made without navigation")
        return False
    return True


def _keep_map(onto: Path, out: Path) -> None:
    """Copy the key scans of a finished map to `out`, from where the mapping reads them."""
    from sonarmap.tools.command.live.kept_keys import forget_keys, keep_key, map_keys
    from sonarmap.tools.files.map_folder.folder import read_map_folder

    forget_keys(out)
    for number, key in enumerate(map_keys(read_map_folder(onto))):
        keep_key(out, number, key)


def _require_source(inputs: list[str], replay: float | None) -> None:
    from sonarmap.tools.files.readers.incoming import GROWING

    if replay is not None:
        if not inputs:
            raise InputError("--replay needs finished scans; name them")
        return
    if len(inputs) > 1:
        raise InputError(f"{len(inputs)} sources given; name one that grows, or give --replay for finished ones")
    for name in inputs:
        path = Path(name)
        if not path.exists():
            raise InputError(f"{name} does not exist; name a growing recording or folder, or none for the network")
        if not (path.is_dir() or path.suffix.lower() in GROWING):
            raise InputError(
                f"{name} is neither a folder nor a recording that may grow ({', '.join(GROWING)}); give --replay 1"
            )
