"""The tables of each experiment. A change of a table does not cause jobs to be run again."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from statistics import median_low
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import chi2

from sonarmap.tools.lab.reproduce import paper_tables as paper
from sonarmap.tools.lab.reproduce.confidence import HELD_OUT, SET_HELD_OUT
from sonarmap.tools.lab.reproduce.registrations import OURS
from sonarmap.tools.lab.reproduce.render import DASH, Cell, Frame, Table, count, joined, number, ratio, share, where
from sonarmap.tools.lab.reproduce.survey import BETWEEN, FATES, ROLES, USUAL
from sonarmap.tools.lab.simulate.kinds.kind import RELIEF_OF

# With correct covariances, 95 % of the normalized squared errors are below this quantile, and their mean is 6
INSIDE = f"nees <= {chi2.ppf(0.95, 6):.9f}"
CALIBRATION: Mapping[str, Cell] = {
    "right, with a covariance": count("right and nees == nees"),
    "in the 95 % ellipsoid": share(INSIDE, "right and nees == nees", "percent"),
    "mean squared error": number("nees", 2, "mean", "right"),
    "median squared error": number("nees", 2, "median", "right"),
}

_SECONDS: Mapping[str, Cell] = {"median [s]": number("seconds", 2), "most [s]": number("seconds", 2, "max")}


def binned(condition: str, column: str, bounds: tuple[float, ...], name: str) -> Callable[[Frame], Frame]:
    """Selects the rows that meet a condition, ordered by a new column `name`: the bin of a number between `bounds`.

    Bins exclude their lower bound and include the upper one. Rows outside of all bins are dropped.
    """
    labels = [f"{max(low, 0):g}..{high:g}" for low, high in pairwise(bounds)]

    def rows(frame: Frame) -> Frame:
        some = where(frame, condition)
        if some.empty:
            return some
        bins = pd.cut(some[column], list(bounds), labels=labels)
        return some.assign(**{name: bins}).dropna(subset=[name]).sort_values(name, kind="stable")

    return rows


def _reach(frame: Frame) -> str:
    ends = paper.last_right(frame, "step", "scene", "seed")
    return f"{paper.step_name(median_low(ends))} ({paper.step_name(min(ends))}..{paper.step_name(max(ends))})"


PAIRS = (
    Table(
        "Right registrations by the share of common points",
        ("turn", "method"),
        {"": share("right", form="percent")},
        rows=binned("set == 'overlap'", "shared", (0, 0.2, 0.4, 0.6, 0.8, 1.0), "overlap shared"),
        across="overlap shared",
    ),
    Table(
        "What each method accepts",
        ("turn", "method"),
        {
            "right": share("right"),
            "accepted": share("accepted", form="plain"),
            "accepted though wrong, of all": share("accepted and not right"),
            "accepted though wrong, of the accepted": share("not right", "accepted", "plain"),
            "refused, of those that share > 40 %": share("not accepted", "shared > 0.4"),
            "refused though right, of the right": share("not accepted", "right"),
        },
        rows="set == 'overlap'",
    ),
    Table(
        "Median errors of right registrations that share more than half, σ² up to 1 m²",
        ("turn", "method"),
        {
            "registrations": count(),
            "rotation [°]": number("rotation_deg", 3),
            "translation [voxels]": number("translation_voxels", 3),
            "translation [m]": number("translation_m", 3),
        },
        rows="set == 'overlap' and right and shared > 0.5 and sigma2 <= 1",
    ),
    Table(
        "Normalized squared errors of right registrations (calibrated: mean 6, median 5.35)",
        ("turn", "method"),
        CALIBRATION,
        rows="set == 'overlap'",
    ),
    Table(
        f"The probability that `{OURS}` reports, and how often it is right",
        ("turn", "reported probability"),
        {"mean of these": number("probability", 3, "mean"), "right": share("right")},
        rows=binned(
            f"set == 'overlap' and method == '{OURS}'",
            "probability",
            (-1e-9, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.99, 1.0),
            "reported probability",
        ),
    ),
    Table(
        "Paths: Table 1, extended to S12",
        ("sigma2", "method"),
        {
            "right, S0 to S9": share("right", "step < 10"),
            "right, S10 to S12": share("right", "step >= 10"),
            "last scan before the first failure: median (worst..best)": _reach,
            "wrong, of the accepted": share("not right", "accepted"),
        },
        rows="set == 'paths'",
    ),
    Table(
        "Unrelated pairs: what is accepted, and the highest values that are reported for any of them",
        ("method",),
        {
            "accepted": share("accepted"),
            "probability": number("probability", 4, "max"),
            "peak-to-sidelobe ratio": number("psr", 1, "max"),
            "overlap": number("overlap", 2, "max"),
        },
        rows="set == 'unrelated'",
    ),
    Table(
        "Preparing both scans and registering them; the first pair of a process also compiles kernels",
        ("set", "method"),
        {"registrations": count(), **_SECONDS},
        times=True,
    ),
)

NOT_FLAT = "relief != 'flat'"  # flat scenes do not constrain a pose


def outcome(frame: Frame) -> str:
    """Share right, share accepted of the right, and number wrong and accepted, as in "93 %, 88 %, 1"."""
    right = where(frame, "right")
    accepted = f"{100 * len(where(right, 'accepted')) / len(right):.0f} %" if len(right) else DASH
    return f"{100 * len(right) / len(frame):.0f} %, {accepted}, {len(where(frame, 'accepted and not right'))}"


def worst_first(frame: Frame) -> Frame:
    """The rows without navigation, ordered by the share right of our method per kind, lowest first; the new column
    `given` has the method and its priors."""
    some = where(frame, "priors != 'navigation'")
    ours = where(some, f"{NOT_FLAT} and method == '{OURS}'")
    shares = (where(some, NOT_FLAT) if ours.empty else ours).groupby("kind")["right"].mean()
    given = some["method"].where(some["priors"] == "none", some["method"] + ", known: " + some["priors"])
    some = some.assign(given=given, share=some["kind"].map(shares).fillna(0.0))
    return some.sort_values("share", kind="stable").drop(columns="share")


def expected_error(frame: Frame) -> float:
    """The expected calibration error of the probability (Guo et al., ICML 2017, arXiv 1706.04599), ten equal bins: the
    absolute difference of mean probability and share right in a bin, averaged over the registrations."""
    rated = frame.dropna(subset=["probability"])
    off = rated["right"].astype(float) - rated["probability"]
    return float(off.groupby(_tenths(rated["probability"])).sum().abs().sum() / len(rated)) if len(rated) else np.nan


def usual_error(frame: Frame) -> float:
    """The mean expected calibration error of exact probabilities of the same values, due to the sample's size alone."""
    p = frame["probability"].dropna().to_numpy()
    if not len(p):
        return np.nan
    bins = _tenths(pd.Series(p)).to_numpy()[:, None] == np.arange(10)
    right_less_p = (np.random.default_rng(0).uniform(size=(1000, len(p))) < p) - p
    return float(np.abs(right_less_p @ bins).sum(axis=1).mean() / len(p))


def _tenths(p: Any) -> Any:
    return (p * 10).astype(int).clip(upper=9)


REPORTED: Mapping[str, Cell] = {
    "registrations": count(),
    "expected calibration error": number(expected_error, 3),
    "calibration error of an exact probability": number(usual_error, 3),
    **CALIBRATION,
}


def directions(frame: Frame) -> Frame:
    """A row for each of the three directions of swaths with navigation; a direction is fixed if its standard deviation
    is below a third of navigation's."""
    some = where(frame, f"priors == 'navigation' and method == '{OURS}'")
    names = ("sigma_m", "navigation_sigma_m", "error_m", "navigation_error_m")
    parts = [
        some[["relief", "number"]].assign(**{name: some[f"direction{k}_{name}"].abs() for name in names})
        for k in (1, 2, 3)
        if f"direction{k}_sigma_m" in some
    ]
    long = pd.concat(parts).dropna() if parts else some.iloc[:0]
    return long if long.empty else long.assign(fixed=long["sigma_m"] < long["navigation_sigma_m"] / 3)


KINDS = (
    Table(
        "Every kind, the worst first: share right, share accepted of the right, number wrong and accepted; no flat "
        "scenes",
        ("kind",),
        {"": outcome},
        rows=lambda frame: where(worst_first(frame), NOT_FLAT),
        across="given",
        total="all kinds",
    ),
    Table("The same by relief; flat scenes cannot fix a pose", ("relief",), {"": outcome}, worst_first, "given"),
    Table(
        f"`{OURS}` by kind, the worst first; flat scenes count in the last column alone",
        ("kind", "priors"),
        {
            "pairs": count(NOT_FLAT),
            "right": share("right", NOT_FLAT, "percent"),
            "accepted, of the right": share("accepted", f"right and {NOT_FLAT}", "percent"),
            "wrong and accepted, of all": share("accepted and not right", form="percent"),
        },
        rows=lambda frame: where(worst_first(frame), f"method == '{OURS}'"),
    ),
    Table(
        f"Probability and covariance of `{OURS}` by kind (calibrated: mean squared error 6)",
        ("kind",),
        REPORTED,
        rows=lambda frame: where(worst_first(frame), f"method == '{OURS}'"),
        total="all kinds",
    ),
    Table("The same by what is known", ("priors",), REPORTED, rows=f"method == '{OURS}'"),
    Table(
        f"Swaths with navigation: errors along the directions that the covariance of `{OURS}` calls fixed",
        ("relief",),
        {
            "directions": count(),
            "fixed": count("fixed"),
            "along them: median error of navigation [m]": number("navigation_error_m", 2, condition="fixed"),
            "of the registration [m]": number("error_m", 2, condition="fixed"),
            "errors within 2 standard deviations": share("error_m < 2 * sigma_m", "fixed"),
            "along the others: navigation [m]": number("navigation_error_m", 2, condition="not fixed"),
            "registration [m]": number("error_m", 2, condition="not fixed"),
        },
        rows=directions,
        total="all",
    ),
)


def _given(frame: Frame) -> Frame:
    """Real pairs with a new column `given`, which has the method and its priors."""
    known = frame["method"].where(frame["known"] == "nothing", frame["method"] + ", known: " + frame["known"])
    return frame.assign(given=known)


def _of_pair(frame: Frame) -> str:
    """The result of one registration, or the numbers of right and accepted ones of several draws."""
    if len(frame) > 1:
        return f"{len(where(frame, 'right'))} of {len(frame)}; {len(where(frame, 'accepted'))} accepted"
    row = frame.iloc[0]
    error = f"{row['rotation_deg']:.2f}, {row['translation_m']:.3f}" if row["right"] else "wrong"
    return f"{error}; accepted" if row["accepted"] else error


_SETS = ("set", "method", "known")
_REAL: Mapping[str, Cell] = {
    "registrations": count(),
    "right": count("right"),
    "accepted": count("accepted"),
    "wrong and accepted": count("accepted and not right"),
    "median error of the right [°]": number("rotation_deg", 3, condition="right"),
    "the same [m]": number("translation_m", 3, condition="right"),
}
REAL = (
    Table("All sets", ("method", "known"), _REAL),
    Table("Right and accepted by set", _SETS, _REAL),
    Table(
        "Every pair: error of what is right [°, m], and whether it is accepted; of several draws, how many are right",
        ("set", "pair"),
        {"": _of_pair},
        rows=_given,
        across="given",
    ),
    Table("Preparing both scans and registering them", _SETS[1:], _SECONDS, times=True),
    Table("The same by set", _SETS, _SECONDS, times=True),
)


_SURVEY = ("scene", "seed", "survey")
SURVEY = (
    Table(
        "Poses and pairs",
        _SURVEY,
        {
            "placed, of the usable": joined(
                " of ", number("placed", 0), lambda frame: f"{frame['scans'].iloc[0] - frame['unusable'].iloc[0]}"
            ),
            "unusable placed": number("placed_unusable", 0),
            "maps of two scans or more": number("components", 0),
            "ATE [voxels]": number("ate_after_voxels", 2),
            "ATE [m]": number("ate_after_m", 3),
            "rotation [°]": number("ate_after_deg", 2),
            "poses in their 95 % ellipsoids": number("within_95", 2),
            "positions": number("position_within_95", 2),
            "mean squared error of poses (6)": number("nees_mean", 1),
            "of positions (3)": number("position_nees_mean", 1),
            "unusable pairs kept": number("unusable_kept", 0),
        },
    ),
    Table(
        "Maps against the true surface",
        _SURVEY,
        {
            "median [m]": number("map_median_m", 2),
            "within a voxel": number("map_within_voxel", 2),
            "points seen twice: median [m]": number("map_twice_median_m", 2),
            "90 % [m]": number("map_twice_p90_m", 2),
            "within a voxel, seen twice": number("map_twice_within_voxel", 2),
        },
    ),
    Table(
        "Pairs: kept right, kept wrong, refused right, refused wrong",
        _SURVEY,
        {role: joined(", ", *(number(f"{role}_{fate}", 0) for fate in FATES)) for role in (*ROLES, BETWEEN)},
    ),
    Table(
        "Times and memory",
        _SURVEY,
        {
            "total [s]": number("total_s", 1),
            "per scan [s]": number("per_scan_s", 1),
            "peak memory [MiB]": number("peak_memory_mib", 0),
        },
        times=True,
    ),
)

SCALE = (
    Table(
        "Poses and loops",
        ("scans", "seed"),
        {
            "scans in one map": number("placed", 0),
            "ATE [m]": number("ate_m", 3),
            "loops kept / tried": joined(" / ", number("kept_loops", 0), number("tried_loops", 0)),
            "wrong pairs kept": number("wrong_kept", 0),
            "points of the map": number("map_points", 0),
        },
    ),
    Table(
        "Processor time and most memory by stage",
        ("seed", "stage"),
        {"": joined(", ", lambda f: f"{f['processor_s'].iloc[0]:.1f} s", lambda f: f"{f['memory_mib'].max():.0f} MiB")},
        across="scans",
        times=True,
    ),
)


def _sum(frame: Frame, *fates: str) -> int:
    return int(frame[[f"{role}_{fate}" for role in ROLES for fate in fates]].sum().sum())


_DECISIONS: Mapping[str, Cell] = {
    "surveys": count(),
    "in one map": count("placed == scans"),
    "ATE [voxels]: median": number("ate_after_voxels", 2),
    "worst": number("ate_after_voxels", 2, "max"),
    "wrong of the kept": lambda frame: f"{_sum(frame, 'kept_wrong')} of {_sum(frame, 'kept_right', 'kept_wrong')}",
    "right but refused": lambda frame: str(_sum(frame, "refused_right")),
    "poses in their 95 % ellipsoids": lambda frame: (
        f"{100 * np.average(frame['within_95'], weights=frame['placed'] - 1):.1f} %"
    ),
    "the worst survey": lambda frame: f"{100 * frame['within_95'].min():.1f} %",
    "mean squared error (6)": number("nees_mean", 1, "mean"),
}
DECISIONS = (
    Table(
        "What each rule is worth",
        ("rule", "relief"),
        _DECISIONS,
        rows=lambda frame: frame.assign(relief=frame["scene"].map(RELIEF_OF)),
    ),
    Table("By scene", ("scene",), _DECISIONS, rows=f"rule == '{USUAL}'"),
)

_CONFIDENCE: Mapping[str, Cell] = {
    "pairs": number("pairs", 0),
    "right": number("right", 0),
    "likely, of the right": ratio("likely_right", "right"),
    "wrong but likely": number("likely_wrong", 0),
    "accepted of the right": ratio("accepted_right", "right"),
    "wrong and accepted": number("accepted_wrong", 0),
    "calibration error": number("calibration_error", 3),
    "in the 95 % ellipsoid": ratio("inside", "near"),
    "mean squared error (6)": number("nees", 2),
    "an unconstrained direction": ratio("open", "near"),
}
CONFIDENCE = (
    Table("By what a pair is; fitted to other pairs", ("by", "group"), _CONFIDENCE, f"fitted_to == '{HELD_OUT}'"),
    Table("By set; fitted to the others", ("group",), _CONFIDENCE, f"by == 'set' and fitted_to == '{SET_HELD_OUT}'"),
)

SHOWN: Mapping[str, tuple[Table, ...]] = {
    "translation": paper.TRANSLATION,
    "rotation": paper.ROTATION,
    "limits": paper.LIMITS,
    "gaussian": paper.GAUSSIAN,
    "floodgate": paper.FLOODGATE,
    "pairs": PAIRS,
    "kinds": KINDS,
    "real": REAL,
    "survey": SURVEY,
    "scale": SCALE,
    "decisions": DECISIONS,
    "confidence": CONFIDENCE,
}
