"""Shifted structures in words and tables: how far registration reaches under each noise, next to the paper."""

from collections.abc import Sequence
from types import MappingProxyType

from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rows import accepted, column, grouped, number, rate, right, where, wrong
from sonarmap.tools.lab.reproduce.structures.moved import RIGHT_DEG, RIGHT_VOXELS
from sonarmap.tools.lab.reproduce.structures.settings import TranslationSettings
from sonarmap.tools.lab.reproduce.table import Table, table_of

# The distance up to which the paper says or shows that registrations succeed [voxels of 1 m] (Figs. 12, 14, 15)
PAPER_REACH: MappingProxyType[str, float] = MappingProxyType(
    {"D0": 150.0, "D1": 140.0, "D2": 140.0, "D3": 140.0, "D4": 140.0, "D5": 120.0, "D6": 110.0}
)
_LEGEND = "{}. Lines are true values, crosses are estimates; gray marks wrong registrations."
# File name -> caption, and the noises in it
PICTURES: MappingProxyType[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "translation-D0.png": (_LEGEND.format("Without noise, as Fig. 12"), ("D0",)),
        "translation-100.png": (_LEGEND.format("Swap ratio 1/100, as Fig. 14"), ("D1", "D3", "D5")),
        "translation-25.png": (_LEGEND.format("Swap ratio 1/25, as Fig. 15"), ("D2", "D4", "D6")),
    }
)
_ROUNDING = 0.5  # [m]: 40 steps are 149.7 m and count as the paper's 150


def translation_section(rows: Sequence[Row], settings: TranslationSettings) -> Section:
    """The reach under every noise, next to the paper's."""
    return Section(
        title="Translation under noise of the voxels: Figs. 12, 14, 15",
        introduction=_introduction(settings),
        tables=(_reach_table(rows, settings), _quality_table(rows, settings)),
        pictures={name: caption for name, (caption, noises) in PICTURES.items() if set(noises) & set(settings.noises)},
        remarks=_remarks(rows, settings),
    )


def reach(rows: Sequence[Row]) -> float:
    """The farthest shift of one series up to which every one is right [m]; 0 where the first is wrong."""
    far = 0.0
    for row in sorted(rows, key=lambda row: row["distance_m"]):
        if not row["right"]:
            break
        far = float(row["distance_m"])
    return far


def _reach_table(rows: Sequence[Row], settings: TranslationSettings) -> Table:
    farthest = max(float(row["distance_m"]) for row in rows)
    lines = []
    for noise in settings.noises:
        paper = PAPER_REACH[noise]
        series = [where(rows, scene=scene, noise=noise, seed=seed) for scene, seed in settings.structures]
        worst = min(series, key=reach)
        verdict = "reached" if reach(worst) >= min(paper, farthest) - _ROUNDING else "not reached"
        if verdict == "reached" and farthest < paper - _ROUNDING:
            verdict = f"reached as far as tried ({farthest:.0f} m)"
        within = [row for row in where(rows, noise=noise) if float(row["distance_m"]) <= paper + _ROUNDING]
        shown = (_shown(worst), verdict, " ".join(map(_shown, series)), rate(right(within), within))
        lines.append((f"{noise}: right up to [m]", f"{paper:.0f}", *shown))
    return Table(
        "Largest shift up to which all registrations are right [m]; ≥: right at every shift that was tried",
        ("noise", "paper", "ours, worst series", "verdict", "ours, every series", "right within the paper's range"),
        tuple(lines),
    )


def _shown(series: Sequence[Row]) -> str:
    """How far one series reaches, with a sign where every shift that was tried is right."""
    return f"{'' if wrong(series) else '≥'}{reach(series):.0f}"


def _quality_table(rows: Sequence[Row], settings: TranslationSettings) -> Table:
    def largest(some: Sequence[Row], name: str) -> float:
        return max(column(right(some), name), default=float("nan"))

    return table_of(
        "Errors, and peak-to-sidelobe ratios (PSR) of right and wrong registrations",
        ("noise",),
        [((noise,), where(rows, noise=noise)) for noise in settings.noises],
        {
            "largest error where right [°, voxels]": lambda some: (
                f"{largest(some, 'rotation_deg'):.2f}°, {largest(some, 'translation_voxels'):.2f}"
            ),
            "lowest PSR where right": lambda some: f"{min(column(right(some), 'psr'), default=float('nan')):.0f}",
            "highest PSR where wrong": lambda some: (
                number(max(column(wrong(some), "psr")), 0) if wrong(some) else "none wrong"
            ),
            "accepted, of the wrong": lambda some: f"{len(accepted(wrong(some)))} of {len(wrong(some))}",
        },
    )


def _remarks(rows: Sequence[Row], settings: TranslationSettings) -> str:
    left = {scene: min(column(some, "common")) for (scene,), some in grouped(rows, "scene").items()}
    shares = ", ".join(f"{left[scene]:.0%} of `{scene}`" for scene in settings.scenes)
    turned = sum(column(wrong(rows), "rotation_deg") > RIGHT_DEG)
    why = f" Of the {len(wrong(rows))} wrong registrations, {turned} have a wrong rotation." if wrong(rows) else ""
    return f"At the farthest shift, the share of the structure left in the grid is {shares} (lowest of all seeds).{why}"


def _introduction(settings: TranslationSettings) -> str:
    scenes = " and of ".join(f"`{scene}`" for scene in settings.scenes)
    grid = settings.grid
    return (
        f"A whole structure (all surfaces of {scenes}, not only what a sensor sees of them) is put into a grid of "
        f"{grid.edge} voxels of {grid.voxel:g} m, with the middle of its height in the middle of the grid. It is then "
        f"shifted by {settings.steps[0]} to {settings.steps[-1]} steps of (1, 2, 3) m, so that more and more of it "
        "leaves the grid. As in Sect. 3 of the paper, a share of the voxels is swapped between occupied and empty, "
        "independently in both volumes: none in D0; 1/100 in D1, D3 and D5; 1/25 in D2, D4 and D6. D1 and D2 swap only "
        "among voxels within 5 voxels of the structure, D3 and D4 within 10 voxels, D5 and D6 among all voxels.\n\n"
        "The paper's method registers the two volumes. It searches all six parameters, starting from one yaw peak. A "
        f"registration is right if it is within {RIGHT_VOXELS:g} voxels and {RIGHT_DEG:g} degrees of the truth. Seeds "
        f"per scene: {settings.seeds}, from {settings.first_seed} on. In a grid of 256 voxels the shifts are whole "
        "voxels, as in the paper; so without noise, the part of the structure that is left in the grid is the same in "
        "both volumes, voxel by voxel."
    )
