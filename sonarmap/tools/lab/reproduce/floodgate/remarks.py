"""Sentences on the results of the flood gate, computed from its rows."""

from collections.abc import Iterable
from statistics import median

from sonarmap.tools.lab.reproduce.floodgate.chain import Chain
from sonarmap.tools.lab.reproduce.floodgate.methods import TRUTH, label
from sonarmap.tools.lab.reproduce.floodgate.tables import Chains, Run, by_seed, map_90, runs_of, seeds_of
from sonarmap.tools.lab.reproduce.rate import wilson


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
