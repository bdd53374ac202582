"""Tables on the flood gate's maps: of every method, of every pair, of every pose."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.floodgate.chain import (
    DISPLACED_90,
    MAP_90,
    MAP_MEDIAN,
    PAIR,
    POSE,
    RIGHT_M,
    TRUTH,
    Run,
    by_run,
    chained,
    label,
)
from sonarmap.tools.lab.reproduce.rows import accepted, column, grouped, middle, right, where, wrong
from sonarmap.tools.lab.reproduce.table import Table, table_of

CLOSE_M = 3.0  # three voxels of the paper's finer grid


def ends(poses: Sequence[Row]) -> list[Row]:
    """The last poses of one run's surveys, in order; they hold the distances of the whole maps."""
    return [some[-1] for some in grouped(poses, "seed").values()]


def map_90(rows: Iterable[Row], run: Run) -> list[float]:
    """Survey by survey, within what distance of the true surface 90 % of the whole map's points lie [m]."""
    return column(ends(by_run(rows, POSE)[run]), MAP_90).tolist()


def listed(values: Iterable[float], form: str = ".2f") -> str:
    """Values of the surveys, as "0.31 / 0.28"."""
    return " / ".join(f"{value:{form}}" for value in values)


def ate_m(pairs: Sequence[Row]) -> float:
    """Root mean square of the positions' errors of one survey after the best rigid alignment [m]."""
    stamps = np.arange(len(pairs) + 1, dtype=np.float64)
    found, true = (Trajectory(stamps, chained(pairs, which)) for which in ("found", "true"))
    return evaluate(found, true).ate_m


def map_table(rows: Sequence[Row]) -> Table:
    """One line a run: pairs, the map, the poses, survey by survey."""
    pairs, poses = by_run(rows, PAIR), by_run(rows, POSE)

    def of_pairs(value: Callable[[list[Row]], float], form: str) -> Callable[[Run], str]:
        return lambda run: listed((value(some) for some in grouped(pairs.get(run, ()), "seed").values()), form)

    def of_poses(value: Callable[[list[Row]], float], form: str = ".2f", truth: bool = False) -> Callable[[Run], str]:
        return lambda run: (
            listed((value(some) for some in grouped(poses[run], "seed").values()), form)
            if truth or run[0] != TRUTH
            else ""
        )

    columns = {
        f"right, of {max(int(row['scan']) for row in rows)} pairs": of_pairs(lambda some: len(right(some)), "d"),
        f"of these within {CLOSE_M:g} m": of_pairs(
            lambda some: sum(column(right(some), "translation_m") <= CLOSE_M), "d"
        ),
        "accepted though wrong": of_pairs(lambda some: len(accepted(wrong(some))), "d"),
        "half of the map's points within [m]": of_poses(lambda some: float(some[-1][MAP_MEDIAN]), truth=True),
        "90 % of the map's points within [m]": of_poses(lambda some: float(some[-1][MAP_90]), truth=True),
        "90 % displaced by at most [m]": of_poses(lambda some: float(some[-1][DISPLACED_90])),
        "ATE [m]": of_pairs(ate_m, ".2f"),
        "largest pose error [m]": of_poses(lambda some: max(column(some, "translation_m"))),
        "largest pose error [degrees]": of_poses(lambda some: max(column(some, "rotation_deg")), ".1f"),
    }
    lines = [((label(*run),), run) for run in poses]
    return table_of("Maps and poses, survey by survey", ("method",), lines, columns)


def pair_table(rows: Sequence[Row]) -> Table:
    """Every pair: its true overlap, and the errors of every run; medians over the surveys."""
    runs = by_run(rows, PAIR)
    first = next(iter(runs.values()))
    lines = []
    for (source,), some in grouped(first, "scan").items():
        shares = (_percent(column(some, name)) for name in ("shared", "overlap"))
        errors = (_error(where(pairs, scan=source)) for pairs in runs.values())
        lines.append((f"{source - 1} → {source}", *shares, *errors))
    return Table(
        f"Every pair: error of the registration{_medians(rows)}; in brackets: how many are wrong "
        f"(beyond 6° or {RIGHT_M:g} m)",
        ("pair", "shared view", "overlap", *(label(*run) for run in runs)),
        tuple(lines),
    )


def pose_table(rows: Sequence[Row]) -> Table:
    """Every scan: the error of its pose in the chain, which starts at the truth; medians over the surveys."""
    runs = {run: poses for run, poses in by_run(rows, POSE).items() if run[0] != TRUTH}
    scans = range(1, 1 + max(int(row["scan"]) for row in rows))
    return Table(
        f"Every pose of the chain, which starts at the true first pose: error{_medians(rows)}",
        ("scan", *(label(*run) for run in runs)),
        tuple((str(scan), *(_error(where(poses, scan=scan)) for poses in runs.values())) for scan in scans),
    )


def _error(rows: list[Row]) -> str:
    """Medians of rotation and translation, and how many are wrong, if the rows say so."""
    bad = sum(not row.get("right", True) for row in rows)
    error = f"{middle(rows, 'rotation_deg'):.1f}°, {middle(rows, 'translation_m'):.2f} m"
    return f"{error} [{bad}]" if bad else error


def _percent(shares: np.ndarray) -> str:
    low, high = round(100 * min(shares)), round(100 * max(shares))
    return f"{low} %" if low == high else f"{low}..{high} %"


def _medians(rows: Sequence[Row]) -> str:
    count = len({row["seed"] for row in rows})
    return f", median of {count} surveys" if count > 1 else ""


# A map corresponds to the truth if 90 % of its points lie at most this farther from it than with true poses: the
# paper's finer voxel [m].
GOOD_M = 1.0
AS_GOOD = 1.1  # times the other map's distance, at most
CLEARLY = 0.5  # times the other map's distance, at most

SPECTRAL = ("hemisphere", "spectral")
_VERY_GOOD = "a very good correspondence with the truth (Fig. 30)"
_MAPS = MappingProxyType(
    {
        "icp": "deficient: dispersed points, distorted, walls misaligned (Figs. 25, 26)",
        "planes": "a good correspondence with the truth (Fig. 28)",
        **dict.fromkeys(SPECTRAL, _VERY_GOOD),
    }
)


def verdict_table(rows: Sequence[Row]) -> Table:
    """The statements: of each map, of each pair of maps, of the two grids."""
    runs = list(by_run(rows, PAIR))
    floor = map_90(rows, (TRUTH, 0))
    lines = []
    for run in runs:
        if said := _MAPS.get(run[0]):
            mine = map_90(rows, run)
            ours = f"90 % of its points within {listed(mine)} m of the truth; with true poses {listed(floor)} m"
            holds = [(a <= b + GOOD_M) == (run[0] != "icp") for a, b in zip(mine, floor, strict=True)]
            lines.append((f"the map by {label(*run)}", said, ours, verdict(holds)))
    grids = {name: sorted(run for run in runs if run[0] == name) for name in SPECTRAL}
    for spectral in (some[-1] for some in grids.values() if some):
        if ("planes", 0) in runs:
            lines.append(_against(rows, spectral, ("planes", 0), "at least as good", lambda a, b: a <= AS_GOOD * b))
        if ("icp", 0) in runs:
            lines.append(_against(rows, spectral, ("icp", 0), "clearly better", lambda a, b: a <= CLEARLY * b))
    for some in grids.values():
        if len(some) > 1:
            alike = "similar qualitative results"
            lines.append(_against(rows, some[0], some[-1], alike, lambda a, b: abs(a - b) <= GOOD_M))
    return Table("What the paper says about the maps", ("claim", "paper", "ours", "verdict"), tuple(lines))


def verdict(held: list[bool]) -> str:
    """In how many surveys a statement holds."""
    if all(held):
        return "holds"
    return f"holds in {sum(held)} of {len(held)} surveys" if any(held) else "does not hold"


def _against(
    rows: Sequence[Row], run: Run, rival: Run, said: str, holds: Callable[[float, float], bool]
) -> tuple[str, ...]:
    mine, theirs = map_90(rows, run), map_90(rows, rival)
    return (
        f"{label(*run)} beside {label(*rival)}",
        f"{said} (Sect. 4.4)",
        f"90 % within {listed(mine)} m beside {listed(theirs)} m",
        verdict([holds(a, b) for a, b in zip(mine, theirs, strict=True)]),
    )


# The pairs 0 -> 1 to 16 -> 17 by ICP (Table 2) [s], a Core 2 Duo of 1.8 GHz, C++. Their mean is 21.346; printed is
# 21.403.
PAPER_ICP = (
    *(47.36, 43.44, 28.17, 1.95, 37.89, 12.00, 26.27, 2.21, 15.34),
    *(17.75, 16.99, 15.70, 1.27, 26.22, 2.56, 41.31, 26.45),
)
PAPER_ICP_MEAN = 21.403
# What Sects. 4.2 to 4.4 say of a method's times [s]: preparing, least, mean, most
_PAPER: Mapping[Run, tuple[str, str, str, str]] = MappingProxyType(
    {
        ("icp", 0): ("", f"{min(PAPER_ICP):g}", f"{PAPER_ICP_MEAN:g}", f"{max(PAPER_ICP):g}"),
        ("planes", 0): ("0.9..1.4", "8", "31", "56"),
        ("hemisphere", 128): ("included", "10.5", "10.5", "10.5"),
        ("hemisphere", 256): ("included", "60.6", "60.6", "60.6"),
    }
)


def times_tables(rows: Sequence[Row]) -> tuple[Table, ...]:
    """Times by method, then by pair (Table 2 as printed, and our medians); of all surveys."""
    if not rows:
        return ()
    runs: dict[Run, list[Row]] = grouped(rows, "method", "grid")
    columns: dict[str, Callable[[Run], str]] = {
        f"paper: {name}": lambda run, k=k: _PAPER.get(run, ("",) * 4)[k]
        for k, name in enumerate(("preparing", "min", "mean", "max"))
    }
    columns["ours: preparing, mean"] = lambda run: f"{column(runs[run], 'prepare_s').mean():.2f}"
    summaries = {"min": np.min, "mean": np.mean, "median": np.median, "max": np.max}
    for name, of in {**summaries, "max / median": lambda seconds: np.max(seconds) / np.median(seconds)}.items():
        columns[f"ours: {name}"] = lambda run, of=of: f"{of(column(runs[run], 'register_s')):.2f}"
    title = (
        "Seconds per registration, without preparing the scans; the paper: fixed for spectral, varying for the others"
    )
    summary = table_of(title, ("method",), [((label(*run),), run) for run in runs], columns)
    lines = []
    for source in sorted({int(row["scan"]) for row in rows}):
        ours = (where(some, scan=source) for some in runs.values())
        cells = (f"{middle(some, 'register_s'):.2f}" if some else "" for some in ours)
        lines.append((f"{source - 1} → {source}", f"{PAPER_ICP[source - 1]:.2f}", *cells))
    means = (f"{column(some, 'register_s').mean():.3f}" for some in runs.values())
    lines.append(("average", f"{PAPER_ICP_MEAN:.3f}", *means))
    headings = ("pair", "paper: ICP", *(f"ours: {label(*run)}" for run in runs))
    return summary, Table("Table 2: seconds of every registration", headings, tuple(lines))
