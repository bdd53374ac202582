"""Neighbors along paths, in words and tables."""

from collections.abc import Callable, Mapping, Sequence

from sonarmap.spectral.judge.covariance import ELLIPSOID
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.beside import Measure, beside_table
from sonarmap.tools.lab.reproduce.evaluation.settings import NeighborsSettings
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.methods import OURS
from sonarmap.tools.lab.reproduce.rows import accepted, by_method, grouped, percent, refused, right, where
from sonarmap.tools.lab.reproduce.table import Table, table_of


def neighbors_section(rows: Sequence[Row], _seconds: Sequence[Row], settings: NeighborsSettings) -> Section:
    """Ours beside the others on the pairs that all register, then ours by scene, sensor and noise."""
    shared = [row for row in rows if int(row["pair"]) < settings.peers]
    ours = where(rows, method=OURS)
    methods = by_method(shared, settings.compared.methods)
    return Section(
        title="Neighbors along paths",
        introduction=_introduction(ours or rows, settings),
        tables=(
            beside_table([measure.line(shared) for measure in _MEASURES] if ours else []),
            table_of(
                "What each method finds and believes, of the pairs that all register", ("method",), methods, _COLUMNS
            ),
            *(_by(name, ours) for name in ("scene", "sensor", "noise")),
        ),
    )


def _by(name: str, rows: Sequence[Row]) -> Table:
    groups = {("all",): list(rows), **grouped(rows, name)} if rows else {}
    return table_of(
        f"`{OURS}` by {name}, of all its pairs", (name,), [((str(k[0]),), v) for k, v in groups.items()], _COLUMNS
    )


def _misled(rows: Sequence[Row]) -> list[Row]:
    """Those that are believed, and off where their covariance calls the pose fixed."""
    return [row for row in accepted(rows) if row["misleads"]]


def _inside(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if float(row["nees"]) <= ELLIPSOID]


_COLUMNS: Mapping[str, Callable[[Sequence[Row]], str]] = {
    "pairs": lambda some: str(len(some)),
    "right": lambda some: percent(right(some), some),
    "believed, of the right": lambda some: percent(accepted(right(some)), right(some)),
    "believed, though off where fixed": lambda some: str(len(_misled(some))),
    "in the 95 % ellipsoid, of the right": lambda some: percent(_inside(right(some)), right(some)),
}
_MEASURES = (
    Measure("right", lambda some: (right(some), some), "neighbors to be found"),
    Measure("refused, of the right", lambda some: (refused(right(some)), right(some)), "of these to be refused", False),
    Measure("believed, though off where fixed", lambda some: (_misled(some), some), "to be believed and wrong", False),
)


def _introduction(rows: Sequence[Row], settings: NeighborsSettings) -> str:
    noises = " and ".join(f"{noise:g}" for noise in settings.noises)
    return (
        f"{len(rows)} pairs of consecutive scans, as a map is made of: {settings.pairs} of each path over "
        f"{len(settings.scenes)} scenes ({', '.join(settings.scenes)}), by {len(settings.sensors)} sensors "
        f"({', '.join(settings.sensors)}; one that reaches no surface of a scene has no path there), with {noises} "
        f"times the usual noise (seed {settings.seed}). Nothing is known but the points. The grid has {settings.edge} "
        "voxels along each edge, their size chosen for a path as `sonarmap map` does. A registration is right within "
        f"{RIGHT_DEG:g} degrees and {RIGHT_VOXELS:g} voxels. One that is believed is wrong if it is off by more along "
        "a direction that its covariance calls fixed: where two standard deviations are no more than that. "
        f"{settings.compared.words} The methods other than `{OURS}` register the first "
        f"{min(settings.peers, settings.pairs)} pairs of each path."
    )
