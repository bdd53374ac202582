"""Lines of pings, as `sonarmap map` takes them and gives them back."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from sonarmap.kernels.counted import counted
from sonarmap.kernels.errors import InputError
from sonarmap.tools.command.navigation import PriorsFile
from sonarmap.tools.command.progress import growing_progress, stage
from sonarmap.tools.command.terminal import say

if TYPE_CHECKING:
    from sonarmap.slam.pings.calibration import PatchTest
    from sonarmap.slam.pings.crossings import Crossings
    from sonarmap.tools.command.mapped import Mapped
    from sonarmap.tools.files.geo.georeference import Georeference
    from sonarmap.tools.files.readers.clouds.cloud import PingPatch
    from sonarmap.tools.files.readers.corrections import Corrections
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.navigation.settings import NavigationSettings
    from sonarmap.tools.files.readers.pings.patches import LineReading
    from sonarmap.tools.files.readers.scans import ReadScans
    from sonarmap.tools.products.output.lines import MovedLine


def without_biases(inputs: Sequence[str], corrections: "Corrections", quiet: bool) -> "Corrections":
    """The corrections with what the patch test of the inputs' lines shows."""
    from sonarmap.slam.pings.calibration import estimate_biases
    from sonarmap.tools.files.readers.pings.line_file import SUFFIXES, read_line
    from sonarmap.tools.files.readers.selection import select_files

    files = [each.path for each in select_files(inputs, SUFFIXES).files if each.path.suffix.lower() in SUFFIXES]
    if len(files) < 2:
        raise InputError(f"--patch-test needs two lines of pings that overlap, and {len(files)} given; leave it out")
    with growing_progress("patch test", quiet) as step:
        lines = []
        for number, path in enumerate(files):
            step(number, len(files) + 1, path.name)
            lines.append(read_line(path, []))
        here = lines[0].origin()
        step(len(files), len(files) + 1, "comparing the lines")
        test = estimate_biases([line.placed(here) for line in lines])
    say(f"patch test: {test_words(test)}; the estimated biases are corrected")
    if not test.observable:
        raise InputError("--patch-test: where the lines overlap no bias shows; leave it out, or add lines")
    return replace(corrections, lines=replace(corrections.lines, biases=test.usable))


def navigated_lines(read: "ReadScans", file: PriorsFile, settings: "NavigationSettings") -> "Navigated":
    """The scans with the navigation of their lines."""
    from sonarmap.tools.files.readers.navigation.priors import Navigated
    from sonarmap.tools.files.readers.pings.patches import placed

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
    """Write what the map says of its lines: navigation, soundings, how well lines agree, and the patch test."""
    from sonarmap.slam.pings.calibration import estimate_biases
    from sonarmap.slam.pings.crossings import crossings
    from sonarmap.tools.files.map_folder.names import OF_LINES
    from sonarmap.tools.products.output.lines import moved_lines, write_lines

    with stage("lines", quiet):
        lines = moved_lines(patches, mapped.result, georeference, reading)
        if not lines:
            return
        before, after = crossings([line.before for line in lines]), crossings([line.after for line in lines])
        test = None
        with suppress(InputError):  # one line, or lines that hardly overlap
            test = estimate_biases([line.before for line in lines])
        write_lines(mapped.out, lines, georeference, crs, (before, after), test)
    mapped.made_of_it.extend(OF_LINES)
    mapped.of_lines.extend(_rows(lines, before, after, test))


def _rows(
    lines: "Sequence[MovedLine]", before: "Crossings", after: "Crossings", test: "PatchTest | None"
) -> list[tuple[str, str]]:
    """What `map` says of its lines at its end."""
    import numpy as np

    far = np.concatenate([np.linalg.norm(line.shifts, axis=1) for line in lines])
    of_lines = counted(len(lines), "line")
    pings, soundings = len(far), sum(len(line.after.pings) for line in lines)
    rows = [
        (
            "lines",
            f"{of_lines}, {pings:,} pings, {soundings:,} soundings; moved by {np.median(far):.2f} m, the median",
        )
    ]
    if before.all.count:
        agreed = f"{after.all.p95:.2g} m ({before.all.p95:.2g} m as recorded)"
        rows.append(("overlaps", f"95 % of {before.cells:,} cells agree within {agreed}, means of soundings"))
    if test is not None:
        rows.append(("biases", f"{test_words(test)}; --patch-test takes them out"))
    return rows


def test_words(test: "PatchTest") -> str:
    """What a patch test says of each bias."""
    from sonarmap.slam.pings.biases import NAMES

    values, sigmas = test.biases.to_json(), test.deviations.to_json()
    words: list[str] = []
    for name, key in zip(NAMES, values, strict=True):
        unit = "s" if key.endswith("_s") else "degrees"
        said = f"{values[key]:+.2f} ± {sigmas[key]:.2f} {unit}"
        words.append(f"{name} {said}" if name in test.observable else f"{name} does not show")
    return ", ".join(words)
