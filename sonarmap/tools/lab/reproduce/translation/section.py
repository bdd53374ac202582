"""Shifted structures in words and tables: how far registration reaches under each noise, next to the paper."""

from collections.abc import Sequence
from types import MappingProxyType

from sonarmap.spectral.grid import Grid
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.rate import wilson
from sonarmap.tools.lab.reproduce.rows import where
from sonarmap.tools.lab.reproduce.structures.voxel_series import RIGHT_DEG, RIGHT_VOXELS, MovedStructure
from sonarmap.tools.lab.reproduce.table import Table
from sonarmap.tools.lab.reproduce.translation.settings import TranslationSettings

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


def translation_section(rows: Sequence[Row], settings: TranslationSettings, grid: Grid) -> Section:
    """The reach under every noise, next to the paper's."""
    shown = {name: caption for name, (caption, noises) in PICTURES.items() if set(noises) & set(settings.noises)}
    return Section(
        title="Translation under noise of the voxels: Figs. 12, 14, 15",
        introduction=_introduction(settings, grid),
        tables=(_reach_table(rows, settings), _quality_table(rows, settings)),
        times=(),
        pictures=shown,
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
        series = [where(rows, scene=c.scene, noise=noise, seed=c.seed) for c in _series_of(settings, noise)]
        worst = min(series, key=reach)
        verdict = "reached" if reach(worst) >= min(paper, farthest) - _ROUNDING else "not reached"
        if verdict == "reached" and farthest < paper - _ROUNDING:
            verdict = f"reached as far as tried ({farthest:.0f} m)"
        within = [row for row in where(rows, noise=noise) if float(row["distance_m"]) <= paper + _ROUNDING]
        rate = str(wilson(sum(bool(row["right"]) for row in within), len(within)))
        lines.append(
            (f"{noise}: right up to [m]", f"{paper:.0f}", _shown(worst), verdict, " ".join(map(_shown, series)), rate)
        )
    return Table(
        "Largest shift up to which all registrations are right [m]; ≥: right at every shift that was tried",
        ("noise", "paper", "ours, worst series", "verdict", "ours, every series", "right within the paper's range"),
        tuple(lines),
    )


def _shown(series: Sequence[Row]) -> str:
    """How far one series reaches, with a sign where every shift that was tried is right."""
    return f"{'≥' if all(row['right'] for row in series) else ''}{reach(series):.0f}"


def _quality_table(rows: Sequence[Row], settings: TranslationSettings) -> Table:
    lines = []
    for noise in settings.noises:
        right = [row for row in where(rows, noise=noise) if row["right"]]
        every = where(rows, noise=noise)
        wrong = [row for row in every if not row["right"]]
        worst = [max((float(row[name]) for row in right), default=float("nan")) for name in _ERRORS]
        lines.append(
            (
                noise,
                f"{worst[0]:.2f}°, {worst[1]:.2f}",
                f"{min((float(row['psr']) for row in right), default=float('nan')):.0f}",
                f"{max(float(row['psr']) for row in wrong):.0f}" if wrong else "none wrong",
                f"{sum(bool(row['accepted']) for row in wrong)} of {len(wrong)}",
            )
        )
    return Table(
        "Errors, and peak-to-sidelobe ratios (PSR) of right and wrong registrations",
        (
            "noise",
            "largest error where right [°, voxels]",
            "lowest PSR where right",
            "highest PSR where wrong",
            "accepted, of the wrong",
        ),
        tuple(lines),
    )


_ERRORS = ("rotation_deg", "translation_voxels")


def _remarks(rows: Sequence[Row], settings: TranslationSettings) -> str:
    left = {scene: min(float(row["common"]) for row in where(rows, scene=scene)) for scene in settings.scenes}
    shares = ", ".join(f"{share:.0%} of `{scene}`" for scene, share in left.items())
    wrong = [row for row in rows if not row["right"]]
    turned = sum(float(row["rotation_deg"]) > RIGHT_DEG for row in wrong)
    why = f" Of the {len(wrong)} wrong registrations, {turned} have a wrong rotation." if wrong else ""
    return f"At the farthest shift, the share of the structure left in the grid is {shares} (lowest of all seeds).{why}"


def _series_of(settings: TranslationSettings, noise: str) -> list[MovedStructure]:
    return [case for case in settings.cases if case.noise == noise]


def _introduction(settings: TranslationSettings, grid: Grid) -> str:
    scenes = " and of ".join(f"`{scene}`" for scene in settings.scenes)
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
