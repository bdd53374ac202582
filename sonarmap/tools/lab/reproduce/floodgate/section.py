"""The flood gate's maps in words and tables."""

from collections.abc import Iterable, Sequence
from statistics import median

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG
from sonarmap.tools.lab.reproduce.experiment import Row, Section
from sonarmap.tools.lab.reproduce.floodgate.chain import RIGHT_M, Chain, chains
from sonarmap.tools.lab.reproduce.floodgate.maps_figure import PICTURES
from sonarmap.tools.lab.reproduce.floodgate.methods import COMPARED, EXTENT, TRUTH, VOXEL, label
from sonarmap.tools.lab.reproduce.floodgate.tables import (
    AS_GOOD,
    CLEARLY,
    GOOD_M,
    Chains,
    Run,
    by_seed,
    map_90,
    map_table,
    pair_table,
    pose_table,
    runs_of,
    seeds_of,
    times_tables,
    verdict_table,
)
from sonarmap.tools.lab.reproduce.rows import wilson


def floodgate_section(
    methods: Sequence[str], missing: Sequence[str], edges: Sequence[int], rows: Sequence[Row], seconds: Sequence[Row]
) -> Section:
    """The section, from the rows of all jobs.

    Args:
        methods: keys of COMPARED that ran.
        missing: those that were left out because their packages are not installed.
        edges: voxels per edge of the grids.
        rows, seconds: of all jobs.
    """
    made = chains(rows)
    return Section(
        title="A flood gate, eighteen scans: Sect. 4, Table 2, Figs. 22 to 31",
        introduction=_introduction(methods, missing, edges, seeds_of(made)),
        tables=(verdict_table(made), map_table(made), pair_table(made), pose_table(made)),
        times=times_tables(seconds),
        pictures=PICTURES,
        remarks=remarks(made),
    )


def _introduction(methods: Sequence[str], missing: Sequence[str], edges: Sequence[int], seeds: Sequence[int]) -> str:
    grids = " and ".join(f"{edge}³ ({EXTENT / edge:g} m)" for edge in edges)
    listed = "\n".join(f"- **{name}**: {COMPARED[name].title}" for name in COMPARED if name in methods)
    absent = f"\n\nNot installed, so left out: {', '.join(missing)}." if missing else ""
    named = ", ".join(map(str, seeds))
    return f"""The paper's scans of the Lesumer Sperrwerk are not public. Ours are simulated: a flood gate of the same
kind, seen by a sensor like the Tritech Eclipse on a path in front of the gate. The true pose of every scan and the true
surface are known. Every method registers every scan to the one before it and knows nothing about the motion. A map is
made by chaining these registrations, starting from the true pose of the first scan; every registration is used, whether
its method accepts it or not. There is no loop closure and no SLAM, as in the paper. Surveys: seeds {named}; each has
its own sea bed, waves and noise.

A pair is right if it is within {RIGHT_DEG:g}° and {RIGHT_M:g} m of the truth at the sensor, for every method. A map is
measured by the distances of all its points to the true surface (point to triangle, exact), and compared with the map
made with true poses, whose distances come from noise alone. A map corresponds to the truth if the distance within which
90 % of its points lie is at most {GOOD_M:g} m, the paper's finer voxel, larger than with true poses. A map is at least
as good as another if that distance is at most {AS_GOOD:g} times the other's, and clearly better if it is at most
{CLEARLY:g} times the other's. These thresholds were set before any run. Points that are displaced along the sea bed
still lie on it, so the table also shows how far points are displaced from their own true places. Grids span
{EXTENT:g} m: {grids}; methods without a grid thin the scans to {VOXEL:g} m.

{listed}{absent}"""


def remarks(chains: Chains) -> str:
    """Overlap, pairs and drift of every run, and the order of the maps."""
    return "\n".join(
        [_overlap(chains), "", *(f"- {_run(chains, run)}" for run in runs_of(chains)), "", _order(chains), "", _PLANES]
    )


# What is not compared, whatever the rows
_PLANES = (
    "The paper draws the map by planes as patches, in which the three gates are sparse and the poles in front of them "
    "are missing (Figs. 28, 29). This is due to how that map is stored, not to the registration. All maps here consist "
    "of points."
)


def _overlap(chains: Chains) -> str:
    first = runs_of(chains)[0]
    rows = [row for seed in seeds_of(chains) for row in chains[seed, *first].pairs]
    shared, overlap = (_range([float(row[name]) for row in rows]) for name in ("shared", "overlap"))
    return (
        f"Of what a scan shows, {shared} is in view of the next or previous scan (the paper: an overlap of about 90 to "
        f"50 %). With noise and few beams, {overlap} of the points have a counterpart within 2 m in the other scan."
    )


def _range(shares: list[float]) -> str:
    return f"{100 * min(shares):.0f} to {100 * max(shares):.0f} %"


def _run(chains: Chains, run: Run) -> str:
    made = [chains[seed, *run] for seed in seeds_of(chains)]
    rows = [row for chain in made for row in chain.pairs]
    right = [row for row in rows if row["right"]]
    text = f"**{label(*run)}**: {wilson(len(right), len(rows))} pairs are right"
    if right:
        rotation, translation = (median(float(row[key]) for row in right) for key in ("rotation_deg", "translation_m"))
        text += f", with median errors of {rotation:.2f}° and {translation:.2f} m"
    return f"{text}. The last pose of the chain is off by {_listed(_last(made))}. {_wrong(chains, run)}."


def _last(made: Iterable[Chain]) -> list[str]:
    return [f"{float(c.poses[-1]['translation_m']):.2f} m / {float(c.poses[-1]['rotation_deg']):.1f}°" for c in made]


def _wrong(chains: Chains, run: Run) -> str:
    """The wrong pairs by name, with their overlap, and how many of them were accepted."""
    wrong = [(seed, row) for seed in seeds_of(chains) for row in chains[seed, *run].pairs if not row["right"]]
    if not wrong:
        return "No pair is wrong"
    shown = [
        f"{int(row['scan']) - 1} → {row['scan']} of seed {seed} ({100 * float(row['shared']):.0f} % shared view)"
        for seed, row in wrong[:6]
    ]
    more = f" and {len(wrong) - 6} more" if len(wrong) > 6 else ""
    accepted = sum(bool(row["accepted"]) for _, row in wrong)
    return f"Wrong: {_listed(shown)}{more}. Accepted though wrong: {accepted} of {len(wrong)}"


def _order(chains: Chains) -> str:
    """Runs by the distance within which 90 % of their maps lie."""
    floor = median(by_seed(chains, (TRUTH, 0), map_90))
    distance = {run: median(by_seed(chains, run, map_90)) for run in runs_of(chains)}
    best = sorted(distance, key=lambda run: distance[run])
    listed = [f"{label(*run)} ({distance[run]:.2f} m)" for run in best]
    return (
        f"Methods by the distance within which 90 % of the map's points lie, best first: {_listed(listed)}; "
        f"with true poses {floor:.2f} m."
    )


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
