"""Tables on the flood gate's maps: of every method, of every pair, of every pose."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median

import numpy as np

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.reproduce.floodgate.chain import DISPLACED_90, MAP_90, MAP_MEDIAN, RIGHT_M, Chain
from sonarmap.tools.lab.reproduce.floodgate.methods import COMPARED, TRUTH, label
from sonarmap.tools.lab.reproduce.table import Table

Chains = Mapping[tuple[int, str, int], Chain]
Run = tuple[str, int]
CLOSE_M = 3.0  # three voxels of the paper's finer grid


def seeds_of(chains: Chains) -> list[int]:
    """The surveys, in order."""
    return sorted({seed for seed, _, _ in chains})


def runs_of(chains: Chains) -> list[Run]:
    """Method and grid of all runs but the true poses, in order."""
    return list(dict.fromkeys((method, edge) for _, method, edge in chains if method != TRUTH))


def shown(runs: Sequence[Run]) -> list[Run]:
    """What the figures show: the methods that are about the paper's, each on its finest grid."""
    paper = [run for run in runs if COMPARED[run[0]].in_figures] or list(runs)
    return [run for run in paper if run == max(grid_run for grid_run in paper if grid_run[0] == run[0])]


def by_seed(chains: Chains, run: Run, value: Callable[[Chain], float]) -> list[float]:
    """One value of a run for each survey, in order."""
    return [value(chains[seed, *run]) for seed in seeds_of(chains)]


def listed(values: Iterable[float], form: str = ".2f") -> str:
    """Values of the surveys, as "0.31 / 0.28"."""
    return " / ".join(f"{value:{form}}" for value in values)


def map_90(chain: Chain) -> float:
    """Within what distance of the true surface 90 % of the whole map's points lie [m]."""
    return float(chain.poses[-1][MAP_90])


def map_median(chain: Chain) -> float:
    """The same for half of them [m]."""
    return float(chain.poses[-1][MAP_MEDIAN])


def displaced_90(chain: Chain) -> float:
    """Within what distance of their own true places 90 % of the whole map's points lie [m]."""
    return float(chain.poses[-1][DISPLACED_90])


def ate_m(chain: Chain) -> float:
    """Root mean square of the positions' errors after the best rigid alignment [m]."""
    stamps = np.arange(len(chain.poses), dtype=np.float64)
    return evaluate(Trajectory(stamps, chain.found), Trajectory(stamps, chain.true)).ate_m


def map_table(chains: Chains) -> Table:
    """One line a run: pairs, the map, the poses, survey by survey."""
    truth = (listed(by_seed(chains, (TRUTH, 0), value)) for value in (map_median, map_90))
    pairs = len(next(iter(chains.values())).poses) - 1
    return Table(
        "Maps and poses, survey by survey",
        (
            "method",
            f"right, of {pairs} pairs",
            f"of these within {CLOSE_M:g} m",
            "accepted though wrong",
            "half of the map's points within [m]",
            "90 % of the map's points within [m]",
            "90 % displaced by at most [m]",
            "ATE [m]",
            "largest pose error [m]",
            "largest pose error [degrees]",
        ),
        ((TRUTH, "", "", "", *truth, "", "", "", ""), *(_map_line(chains, run) for run in runs_of(chains))),
    )


def _map_line(chains: Chains, run: Run) -> tuple[str, ...]:
    counts = (
        lambda c: c.right,
        lambda c: sum(bool(r["right"]) and float(r["translation_m"]) <= CLOSE_M for r in c.pairs),
        lambda c: sum(bool(r["accepted"]) and not r["right"] for r in c.pairs),
    )
    meters = (map_median, map_90, displaced_90, ate_m, lambda c: float(c.column("translation_m").max()))
    turned = by_seed(chains, run, lambda c: float(c.column("rotation_deg").max()))
    return (
        label(*run),
        *(listed(by_seed(chains, run, value), "d") for value in counts),
        *(listed(by_seed(chains, run, value)) for value in meters),
        listed(turned, ".1f"),
    )


def pair_table(chains: Chains) -> Table:
    """Every pair: its true overlap, and the errors of every run; medians over the surveys."""
    first = next(iter(runs_of(chains)))
    sources = [int(row["scan"]) for row in chains[seeds_of(chains)[0], *first].pairs]
    lines = []
    for k, source in enumerate(sources):
        rows = {run: [chains[seed, *run].pairs[k] for seed in seeds_of(chains)] for run in runs_of(chains)}
        shares = (_percent([float(row[name]) for row in rows[first]]) for name in ("shared", "overlap"))
        lines.append((f"{source - 1} → {source}", *shares, *(_error(of) for of in rows.values())))
    return Table(
        f"Every pair: error of the registration{_medians(chains)}; in brackets: how many are wrong "
        f"(beyond 6° or {RIGHT_M:g} m)",
        ("pair", "shared view", "overlap", *(label(*run) for run in runs_of(chains))),
        tuple(lines),
    )


def pose_table(chains: Chains) -> Table:
    """Every scan: the error of its pose in the chain, which starts at the truth; medians over the surveys."""
    scans = range(1, len(next(iter(chains.values())).poses))
    return Table(
        f"Every pose of the chain, which starts at the true first pose: error{_medians(chains)}",
        ("scan", *(label(*run) for run in runs_of(chains))),
        tuple(
            (
                str(scan),
                *(_error([chains[seed, *run].poses[scan] for seed in seeds_of(chains)]) for run in runs_of(chains)),
            )
            for scan in scans
        ),
    )


def _error(rows: list[Row]) -> str:
    """Medians of rotation and translation, and how many are wrong, if the rows say so."""
    rotation, translation = (median(float(row[name]) for row in rows) for name in ("rotation_deg", "translation_m"))
    wrong = sum(not row.get("right", True) for row in rows)
    return f"{rotation:.1f}°, {translation:.2f} m" + (f" [{wrong}]" if wrong else "")


def _percent(shares: list[float]) -> str:
    low, high = round(100 * min(shares)), round(100 * max(shares))
    return f"{low} %" if low == high else f"{low}..{high} %"


def _medians(chains: Chains) -> str:
    count = len(seeds_of(chains))
    return f", median of {count} surveys" if count > 1 else ""
