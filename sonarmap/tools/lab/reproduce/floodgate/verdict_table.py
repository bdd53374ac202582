"""The paper's statements on its three maps, and whether they hold for ours; thresholds were set before any run."""

from collections.abc import Callable

from sonarmap.tools.lab.reproduce.floodgate.methods import TRUTH, label
from sonarmap.tools.lab.reproduce.floodgate.tables import Chains, Run, by_seed, listed, map_90, runs_of
from sonarmap.tools.lab.reproduce.table import Table

# A map corresponds to the truth if 90 % of its points lie at most this farther from it than with true poses: the
# paper's finer voxel [m].
GOOD_M = 1.0
AS_GOOD = 1.1  # times the other map's distance, at most
CLEARLY = 0.5  # times the other map's distance, at most

HOLDS, FAILS = "holds", "does not hold"
SPECTRAL = ("hemisphere", "spectral")

_MAPS = {
    "icp": "deficient: dispersed points, distorted, walls misaligned (Figs. 25, 26)",
    "planes": "a good correspondence with the truth (Fig. 28)",
    "spectral": "a very good correspondence with the truth (Fig. 30)",
}


def verdict_table(chains: Chains) -> Table:
    """The statements: of each map, of each pair of maps, of the two grids."""
    runs = runs_of(chains)
    lines = [_map_line(chains, run) for run in runs if run[0] in ("icp", "planes", *SPECTRAL)]
    for spectral in _finest(runs):
        lines += [_against(chains, spectral, rival) for rival in (("planes", 0), ("icp", 0)) if rival in runs]
    for method in SPECTRAL:
        grids = sorted(edge for name, edge in runs if name == method)
        if len(grids) > 1:
            lines.append(_grids(chains, (method, grids[0]), (method, grids[-1])))
    return Table("What the paper says about the maps", ("claim", "paper", "ours", "verdict"), tuple(lines))


def verdict(held: list[bool]) -> str:
    """In how many surveys a statement holds."""
    if all(held):
        return HOLDS
    return f"holds in {sum(held)} of {len(held)} surveys" if any(held) else FAILS


def good(chains: Chains, run: Run) -> list[bool]:
    """Survey by survey, whether the map corresponds to the truth."""
    floor = by_seed(chains, (TRUTH, 0), map_90)
    return [mine <= least + GOOD_M for mine, least in zip(by_seed(chains, run, map_90), floor, strict=True)]


def _map_line(chains: Chains, run: Run) -> tuple[str, ...]:
    said = _MAPS["spectral" if run[0] in SPECTRAL else run[0]]
    held = [not corresponds for corresponds in good(chains, run)] if run[0] == "icp" else good(chains, run)
    floor = listed(by_seed(chains, (TRUTH, 0), map_90))
    ours = f"90 % of its points within {listed(by_seed(chains, run, map_90))} m of the truth; with true poses {floor} m"
    return (f"the map by {label(*run)}", said, ours, verdict(held))


def _against(chains: Chains, spectral: Run, rival: Run) -> tuple[str, ...]:
    mine, theirs = (by_seed(chains, run, map_90) for run in (spectral, rival))
    share, said = (AS_GOOD, "at least as good") if rival[0] == "planes" else (CLEARLY, "clearly better")
    return (
        f"{label(*spectral)} beside {label(*rival)}",
        f"{said} (Sect. 4.4)",
        f"90 % within {listed(mine)} m beside {listed(theirs)} m",
        verdict(_each(mine, theirs, lambda a, b: a <= share * b)),
    )


def _grids(chains: Chains, coarse: Run, fine: Run) -> tuple[str, ...]:
    small, large = (by_seed(chains, run, map_90) for run in (coarse, fine))
    return (
        f"{label(*coarse)} beside {label(*fine)}",
        "similar qualitative results (Sect. 4.4)",
        f"90 % within {listed(small)} m beside {listed(large)} m",
        verdict(_each(small, large, lambda a, b: abs(a - b) <= GOOD_M)),
    )


def _each(mine: list[float], theirs: list[float], holds: Callable[[float, float], bool]) -> list[bool]:
    return [holds(a, b) for a, b in zip(mine, theirs, strict=True)]


def _finest(runs: list[Run]) -> list[Run]:
    """The spectral methods, each on its finest grid."""
    return [max(run for run in runs if run[0] == name) for name in SPECTRAL if any(run[0] == name for run in runs)]
