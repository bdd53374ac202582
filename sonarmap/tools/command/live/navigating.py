# pyright: strict
"""Navigation while the vehicle dives: files that grow, read again as `sonarmap map` reads them, for key scans."""

import tempfile
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from sonarmap.slam.motion.odometry import Odometry
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.navigation import NavigationReading, OdometryFile, PriorsFile
from sonarmap.tools.files.geo.georeference import Georeference
from sonarmap.tools.files.readers.navigation.odometry import read_odometry
from sonarmap.tools.files.readers.navigation.priors import navigate
from sonarmap.tools.files.readers.navigation.settings import NavigationSettings

_TEXTS = (".csv", ".txt", ".tum", ".nmea", ".log")  # whose last line may be half written


@dataclass(frozen=True, slots=True)
class Navigation:
    """The options that say what there is. Raises InputError: ones that cannot be."""

    priors: PriorsFile
    odometry: OdometryFile
    reading: NavigationReading
    fastest: float | None = None  # that the vehicle goes [m/s]
    origin: Georeference | None = None  # of the map; None for the first fix

    def __post_init__(self) -> None:
        self._settings()
        _ = self.odometry.drift

    def __call__(self, scans: Sequence[Scan]) -> tuple[Sequence[Scan], Odometry | None]:
        """The scans with their priors, and the dead reckoning at their times, as far as the files go. Where one says
        nothing yet, or cannot be read now, the scans stay as they are: the map at the end says what is wrong."""
        odometry, settings = None, self._settings()
        if self.priors.priors:
            with suppress(Exception), ExitStack() as stack:
                paths = [stack.enter_context(_whole_lines(path)) for path in self.priors.priors]
                scans = navigate(scans, paths, settings, allow_unknown=True).scans
        if self.odometry.odometry is not None:
            with suppress(Exception), _whole_lines(self.odometry.odometry) as path:
                odometry = read_odometry(path, scans, *self.odometry.drift, settings=settings)
        return scans, odometry

    def _settings(self) -> NavigationSettings:
        settings = self.reading.settings(*self.priors.priors, self.odometry.odometry, origin=self.origin)
        return replace(settings, sigmas=self.priors.sigmas or settings.sigmas, fastest=self.fastest)


@contextmanager
def _whole_lines(path: Path) -> Generator[Path]:
    """A file, or of a text what is written of it so far but for the line that is being written."""
    if path.suffix.lower() not in _TEXTS:
        yield path
        return
    with tempfile.NamedTemporaryFile(suffix=path.suffix) as copy:
        content = path.read_bytes()
        copy.write(content[: content.rfind(b"\n") + 1])
        copy.flush()
        yield Path(copy.name)
