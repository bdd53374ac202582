"""Every kind of file that is read, damaged at random: refused with a message, or read as usable data."""

import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from zlib import crc32

import numpy as np

from sonarmap.kernels import kept_child as module
from sonarmap.kernels.errors import InputError
from sonarmap.slam.execute.journal import Journal, JournalEntry
from sonarmap.slam.execute.pair_text import from_text, to_text
from sonarmap.spectral.scan import Scan
from sonarmap.tools.command.overview import overview_of
from sonarmap.tools.files.readers.clouds.cloud import COORDINATE_LIMIT
from sonarmap.tools.files.readers.scans import read_scans
from tests.samples.bags.samples import recordings
from tests.samples.cloud_files import SAMPLES, TABLE, las
from tests.samples.damage.folder_files import folder_files
from tests.samples.damage.mutations import mutated
from tests.samples.damage.navigation_files import NAVIGATION_FILES
from tests.samples.damage.pose_files import POSE_FILES, Readable, numbers_in, read_as_odometry
from tests.samples.processor_time import processor_time
from tests.samples.surveys import random_covariance, random_transforms, registration

MOST_WORDS = 2000  # characters of a message
# Formats with a count of points, which reveals missing ones; that of LAZ before 1.4 does not.
COUNTED = (".ply", ".pcd", ".npy", ".npz", ".las")


@dataclass(slots=True)
class Outcome:
    """Counts of outcomes by kind of file, faults, longest processor time [s], and largest growth of memory [bytes]."""

    ends: dict[str, Counter[str]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    longest: tuple[float, str] = (0.0, "")
    largest: tuple[int, str] = (0, "")


def check_usable(scan: Scan) -> None:
    """Check that a scan is valid."""
    assert len(scan.points) >= 1
    assert np.isfinite(scan.points).all()
    assert np.abs(scan.points).max() <= COORDINATE_LIMIT
    assert np.isfinite(scan.stamp)
    if scan.strength is not None:
        assert scan.strength.shape == (len(scan.points),)
        assert np.isfinite(scan.strength).all()
        assert (scan.strength >= 0).all()


def _check_scans(path: Path) -> None:
    overview_of([path])
    read = read_scans([path])
    for scan in read.scans:
        check_usable(scan)
    if path.suffix in COUNTED and len(read.scans[0].points) < len(TABLE):
        assert read.notes, "fewer points than were written, and no word of it"


def _check_poses(read: Callable[[Path], object]) -> Callable[[Path], None]:
    def check(path: Path) -> None:
        assert all(np.isfinite(numbers).all() for numbers in numbers_in(read(path)))

    return check


def _journal_entries() -> list[JournalEntry]:
    rng = np.random.default_rng(5)
    texts = [to_text(registration(T, random_covariance(rng))) for T in random_transforms(rng, 12)]
    return [JournalEntry(f"key {k}", f"scan{k} - scan{k + 1}", text, 0.5 + k) for k, text in enumerate(texts)]


def _journal() -> Readable:
    entries = _journal_entries()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "journal.sqlite"
        with Journal(path) as journal:
            journal.add(entries)
        content = path.read_bytes()

    def check(path: Path) -> None:
        with Journal(path) as journal:
            for entry in entries:
                found = journal.entry(entry.key)
                assert found in (None, entry), "a changed row was taken for the one that was kept"
                from_text(entry.content)
            journal.add(entries)
            assert [journal.entry(entry.key) for entry in entries] == entries

    return Readable("journal.sqlite", content, check)


def readables() -> dict[str, Readable]:
    """Undamaged files of every kind."""
    scans = {kind: Readable(f"scan{suffix}", content, _check_scans) for kind, (suffix, content) in SAMPLES.items()}
    poses = {kind: Readable(file.name, file.content, _check_poses(file.read)) for kind, file in POSE_FILES.items()}
    return {
        **scans, **_las_files(), **_recordings(), **poses, **NAVIGATION_FILES, **folder_files(), "journal": _journal(),
    }  # fmt: skip


def _las_files() -> dict[str, Readable]:
    times = np.arange(len(TABLE)) / 8.0
    rng = np.random.default_rng(1)
    many = np.hstack([rng.normal(0, 5, (50, 3)), rng.integers(0, 60_000, (50, 1))])
    flat = np.column_stack([*np.divmod(np.arange(100.0), 30), np.zeros(100), np.full(100, 7)])
    contents = {
        "las": las(compressed=False, form=0, version="1.2"),
        "las of 1.4": las(compressed=False, gps=times),
        "laz": las(form=3, version="1.2", gps=times),
        "laz of 1.4": las(form=7, gps=times),
        "laz of more": las(many, form=3, version="1.2", gps=np.arange(50) / 8.0),
        "laz of a plane": las(flat, gps=np.arange(100) / 8.0),
    }
    return {kind: Readable(f"scan.{kind[:3]}", content, _check_scans) for kind, content in contents.items()}


def _recordings() -> dict[str, Readable]:
    """Bags and MCAP files read as scans, and some as odometry."""
    scans = {kind: Readable(f"scan{suffix}", content, _check_scans) for kind, (suffix, content) in recordings().items()}
    poses = {
        f"{kind} as odometry": Readable(scans[kind].name, scans[kind].content, _check_poses(read_as_odometry))
        for kind in ("bag lz4", "mcap zstd", "db3")
    }
    return scans | poses


def damage(folder: Path, each: int, seed: int, files: dict[str, Readable] | None = None) -> Outcome:
    """Damage every kind of file `each` times in an empty folder; a seed gives the same damages."""
    files, outcome = files or readables(), Outcome()
    contents = [file.content for file in files.values()]
    for kind, file in files.items():
        ends = outcome.ends[kind] = Counter()
        for number in range(each):
            rng = np.random.default_rng([seed, crc32(kind.encode()), number])
            changed = mutated(file.content, contents[rng.integers(len(contents))], rng)
            for left in folder.iterdir():
                left.unlink()
            (folder / file.name).write_bytes(changed)
            which = f"{kind} {number}"
            before, start = _forget_peaks(), processor_time()
            ends[_end(file, folder / file.name, which, outcome.faults)] += 1
            outcome.longest = max(outcome.longest, (processor_time() - start, which))
            outcome.largest = max(outcome.largest, (_growth(before), which))
    return outcome


def _end(file: Readable, path: Path, which: str, faults: list[str]) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            file.read(path)
    except InputError as error:
        if "ended with SIG" in str(error):
            return "crashed apart"
        if 20 < len(str(error)) < MOST_WORDS and "exit code" not in str(error):
            return "refused"
        faults.append(f"{which}: {str(error)[:200] or 'refused without a word'}")
    except Exception as error:  # noqa: BLE001 - every one of them is a fault to report
        faults.append(f"{which}: {type(error).__name__}: {str(error)[:200]}")
    else:
        return "read"
    return "fault"


def _forget_peaks() -> dict[Path, int]:
    """Reset peak memory of this process and of the reading process, if the system can; returns current peaks."""
    for process in _processes():
        with suppress(OSError):
            (process / "clear_refs").write_text("5", encoding="ascii")
    return {process: _peak(process) for process in _processes()}


def _growth(before: dict[Path, int]) -> int:
    """Largest growth of peak memory of either process since then [bytes]; 0 if unknown."""
    return max(_peak(process) - before.get(process, 0) for process in _processes())


def _peak(process: Path) -> int:
    with suppress(OSError):
        lines = (process / "status").read_text(encoding="ascii").splitlines()
        return sum(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))
    return 0


def _processes() -> list[Path]:
    kept = [] if module._reader is None else [str(module._reader[1].pid)]
    return [Path("/proc") / process for process in ("self", *kept)]
