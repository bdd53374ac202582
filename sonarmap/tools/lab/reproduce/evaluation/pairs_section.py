"""The pair set in words."""

from collections.abc import Callable, Iterable, Sequence

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.beside import Line, Measure, beside_table, others_of
from sonarmap.tools.lab.reproduce.calibration_tables import (
    OVERLAPS,
    CovarianceCheck,
    calibration,
    calibration_table,
    reliability_table,
    shared,
)
from sonarmap.tools.lab.reproduce.evaluation.pairs_figure import NEES, OVERLAP, PROBABILITY
from sonarmap.tools.lab.reproduce.evaluation.settings import PairsSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import accepted, in_percent, middle, percent, rate, refused, right, where, wrong
from sonarmap.tools.lab.reproduce.table import Table, table_of


def pairs_section(rows: Sequence[Row], settings: PairsSettings) -> Section:
    """Ours beside the others, then every method's success and acceptance, then the calibration of ours."""
    methods = settings.compared.methods
    yaw, free = where(rows, turn="yaw"), where(rows, turn="any")
    tables = [
        beside_others(yaw, free),
        overlap_table(yaw, methods, "Right registrations by overlap: any yaw, tilt up to 35 degrees"),
        overlap_table(free, methods, "Right registrations by overlap: any rotation"),
        trust_table(yaw, methods, "What each method accepts: any yaw, tilt up to 35 degrees"),
        trust_table(free, methods, "What each method accepts: any rotation"),
        scene_table(yaw, methods),
        accuracy_table(yaw, methods),
        calibration_table(yaw, free, methods),
        reliability_table(yaw, free),
    ]
    pictures = {
        OVERLAP: f"Share of right registrations against the overlap. The band is the 95 % interval of `{OURS}`."
    }
    if OURS in methods:
        pictures |= {
            NEES: f"Normalized squared errors of the right registrations of `{OURS}`, and the chi-squared density.",
            PROBABILITY: f"How often `{OURS}` is right against the probability it reports. The numbers are counts of "
            "registrations.",
        }
    return Section(
        title="Pairs of every overlap",
        introduction=_introduction(rows, settings),
        tables=tuple(table for table in tables if table.rows or table is tables[0]),
        pictures=pictures,
    )


def _introduction(rows: Sequence[Row], settings: PairsSettings) -> str:
    available = {turn: len({row["number"] for row in where(rows, turn=turn)}) for turn in settings.counts}
    short = [
        f"{count - available[turn]} of {count} ({turn})"
        for turn, count in settings.counts.items()
        if available[turn] < count
    ]
    peers = {min(settings.registers(method, turn) for method in settings.compared.methods) for turn in settings.counts}
    fewer = ""
    if min(peers) < min(settings.counts.values()):
        numbers = " and ".join(str(n) for n in sorted(peers, reverse=True))
        fewer = f" The methods other than `{OURS}` register only the first {numbers} of these pairs."
    scenes = ", ".join(f"`{scene}`" for scene in dict.fromkeys(row["scene"] for row in rows))
    return (
        f"{available['yaw']} pairs whose source is turned by any yaw and tilted by up to 35 degrees of roll and pitch, "
        f"and {available['any']} pairs whose source is turned by any rotation (for these, `{OURS}` runs without its "
        f"limit on roll and pitch; the other methods run unchanged). The scenes are {scenes}; each pair has a "
        f"scene seed of its own (set {settings.seed}). The scans of a pair share 5 to 100 % of their points, with "
        "equally many pairs in each fifth. The variance of the range noise is 0, 1 or 2 m² at the largest range of a "
        "scene of 256 m, and less in smaller scenes; there are also outliers, dropouts, ghosts and speckle. The grid "
        f"has {settings.edge} voxels along each edge; their size is chosen from the two scans. A registration is right "
        f"if it is within {RIGHT_DEG:g} degrees and {RIGHT_VOXELS:g} voxels of the truth. {settings.compared.words}"
        f"{fewer}" + (f" Left out, because the scene has no such pair: {', '.join(short)}." if short else "")
    )


CLEAR = 0.4  # of the points in common: pairs that share more should be accepted


def overlap_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """Right registrations by method and overlap, whether accepted or not."""
    lines = []
    for method in methods:
        some = where(rows, method=method)
        by_overlap = [shared(some, low, high) for low, high in OVERLAPS]
        lines.append((method, *(percent(right(pairs), pairs) for pairs in by_overlap), rate(right(some), some)))
    count = [len(shared(where(rows, method=methods[0]), low, high)) for low, high in OVERLAPS]
    spans = (f"{low:.0%}..{high:.0%} ({n} pairs)" for (low, high), n in zip(OVERLAPS, count, strict=True))
    title = f"{title}. The headings say how many pairs `{methods[0]}` registers"
    return Table(title, ("method", *spans, "all"), tuple(lines) if rows else ())


def trust_table(rows: Sequence[Row], methods: Sequence[str], title: str) -> Table:
    """How many registrations are accepted and refused, rightly or not."""
    return table_of(
        title,
        ("method",),
        [((method,), where(rows, method=method)) for method in methods if rows],
        {
            "accepted": lambda some: f"{len(accepted(some))}/{len(some)}",
            "accepted though wrong, of all": lambda some: rate(wrong(accepted(some)), some),
            "accepted though wrong, of the accepted": lambda some: (
                f"{len(wrong(accepted(some)))}/{len(accepted(some))}"
            ),
            f"refused, of those that share > {CLEAR:.0%}": lambda some: rate(
                refused(shared(some, CLEAR)), shared(some, CLEAR)
            ),
            "refused though right, of the right": lambda some: rate(refused(right(some)), right(some)),
        },
    )


def scene_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Right registrations by method and scene, and how many are accepted though wrong."""
    scenes = list(dict.fromkeys(str(row["scene"]) for row in rows))
    lines = []
    for method in methods:
        by_scene = [where(rows, method=method, scene=scene) for scene in scenes]
        cells = (f"{percent(right(pairs), pairs)}, {len(wrong(accepted(pairs)))}" for pairs in by_scene)
        lines.append((method, *cells))
    title = "Right registrations by scene, then how many are accepted though wrong: any yaw, tilt up to 35 degrees"
    return Table(title, ("method", *scenes), tuple(lines) if rows else ())


def accurate(rows: Iterable[Row]) -> list[Row]:
    """Right registrations of pairs that share more than half, at noise up to the paper's first."""
    return [row for row in shared(right(rows), 0.5) if float(row["sigma2"]) <= 1]


def accuracy_table(rows: Sequence[Row], methods: Sequence[str]) -> Table:
    """Errors of right registrations of pairs that share much, under little noise."""
    groups = [((method,), accurate(where(rows, method=method))) for method in methods]
    return table_of(
        "Median errors of right registrations, more than half shared, σ² up to 1 m²: any yaw, tilt up to 35 degrees",
        ("method",),
        [group for group in groups if group[1]],
        {
            "registrations": lambda some: str(len(some)),
            "rotation [°]": lambda some: f"{middle(some, 'rotation_deg'):.3f}",
            "translation [voxels]": lambda some: f"{middle(some, 'translation_voxels'):.3f}",
            "translation [m]": lambda some: f"{middle(some, 'translation_m'):.3f}",
        },
    )


def beside_others(yaw: Sequence[Row], free: Sequence[Row]) -> Table:
    """Ours beside the others; no rows where ours did not run."""
    lines: list[Line] = []
    for words, rows in (("any yaw", yaw), ("any rotation", free)):
        measures = (
            Measure(
                f"accepted yet wrong, {words}",
                lambda r: (wrong(accepted(r)), r),
                "pairs to be accepted though wrong",
                most=False,
            ),
            Measure(
                f"refused though more than {CLEAR:.0%} is shared, {words}",
                lambda r: (refused(shared(r, CLEAR)), shared(r, CLEAR)),
                "such pairs to be refused",
                most=False,
            ),
        )
        lines += [measure.line(rows) for measure in measures if where(rows, method=OURS)]
    for unit, name in (("°", "rotation_deg"), ("voxels", "translation_voxels")):
        if some := accurate(where(yaw, method=OURS)):
            ours, others = f"{middle(some, name):.3f}", others_of(accurate(yaw), _median_of(name), "{:.3f}".format)
            what = f"median error of what is right, more than half shared, σ² up to 1 m² [{unit}]"
            lines.append((what, ours, others, f"half of such registrations are within {ours} {unit} of the truth"))
    return beside_table([*lines, *_calibration(yaw)])


def _median_of(name: str) -> Callable[[Sequence[Row]], float | None]:
    return lambda rows: middle(rows, name) if rows else None


def _calibration(yaw: Sequence[Row]) -> list[Line]:
    def of(rows: Sequence[Row], value: Callable[[CovarianceCheck], float]) -> float | None:
        checked = calibration(right(rows))
        return None if checked is None else value(checked)

    ours = calibration(right(where(yaw, method=OURS)))
    if ours is None:
        return []
    mean = f"{ours.mean:.2f}; 95 % of calibrated means lie within {ours.low:.2f}..{ours.high:.2f}"
    means = others_of(yaw, lambda rows: of(rows, lambda c: c.mean), "{:.2f}".format)
    shares = others_of(yaw, lambda rows: of(rows, lambda c: c.share), in_percent, most=True)
    inside = f"{ours.share:.1%} ({ours.inside})"
    factor = f"reported standard deviations are {(6 / ours.mean) ** 0.5:.2f} times those of the errors"
    expected = f"expect {100 * ours.share:.0f} of 100 truths in the 95 % ellipsoid"
    return [
        ("mean normalized squared error of what is right (calibrated: 6)", mean, means, factor),
        ("within the 95 % ellipsoid", inside, shares, expected),
    ]
