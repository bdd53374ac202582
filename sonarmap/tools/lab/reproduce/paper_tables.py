"""The tables of the paper's experiments, with the numbers that the paper gives."""

from collections.abc import Callable
from statistics import median_low

import numpy as np

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.tools.lab.evaluate.trajectory import evaluate
from sonarmap.tools.lab.reproduce.paper_scans import DISPLACED_90, MAP_90, MAP_MEDIAN, PAIR, POSE, chained
from sonarmap.tools.lab.reproduce.registrations import less_turns
from sonarmap.tools.lab.reproduce.render import DASH, Cell, Frame, Table, count, joined, number, share, where

# Noise -> distance up to which registrations succeed in the paper [voxels of 1 m] (Figs. 12, 14, 15)
PAPER_REACH = {"D0": 150, "D1": 140, "D2": 140, "D3": 140, "D4": 140, "D5": 120, "D6": 110}
_ROUNDING = 0.5  # [m], as distances are not round: 40 steps are 149.7 m
# Variance of the noise [m^2] -> last scan up to which registrations succeed in the paper (Figs. 20, 21)
PAPER_LAST = {1.0: 8, 2.0: 6}


def reach(series: Frame) -> float:
    """The largest shift of a series up to which all registrations are right [m]; 0 if the first is wrong."""
    ordered = series.sort_values("distance_m", kind="stable")
    right = ordered["distance_m"][ordered["right"].astype(int).cummin() == 1]
    return float(right.max()) if len(right) else 0.0


def _series(frame: Frame) -> list[Frame]:
    return [series for _, series in frame.groupby(["scene", "seed"], sort=False)]


def _shown_reach(series: Frame) -> str:
    return f"{'≥' if series['right'].all() else ''}{reach(series):.0f}"


def _within_range(frame: Frame) -> str:
    paper = PAPER_REACH[frame["noise"].iloc[0]]
    return share("right", f"distance_m <= {paper + _ROUNDING}")(frame)


TRANSLATION = (
    Table(
        "Largest shift up to which all registrations are right [m]; ≥: right at every shift",
        ("noise",),
        {
            "paper": lambda frame: str(PAPER_REACH[frame["noise"].iloc[0]]),
            "ours, worst series": lambda frame: _shown_reach(min(_series(frame), key=reach)),
            "every series": lambda frame: " ".join(map(_shown_reach, _series(frame))),
            "right within the paper's range": _within_range,
            "accepted, of the wrong": share("accepted", "not right", "plain"),
        },
    ),
)

# Largest errors of the angles in the paper's Figs. 16 and 17 [degrees]
_DEVIATION = {"yaw": 5, "roll": 3, "pitch": 3}
_WITHIN = " and ".join(f"{name}_off <= {most}" for name, most in _DEVIATION.items()) + " and translation_voxels <= 2"


def deviations(frame: Frame) -> Frame:
    """The rows with new columns of the absolute errors of the angles [degrees]."""
    off = {name: frame[f"found_{name}_deg"] - frame[f"true_{name}_deg"] for name in _DEVIATION}
    return frame.assign(**{f"{name}_off": abs(less_turns(values)) for name, values in off.items()})


ROTATION = (
    Table(
        "Deviations from the true angles",
        ("noise",),
        {
            "paper: yaw / roll / pitch [°]": lambda _: " / ".join(map(str, _DEVIATION.values())),
            "ours, largest [°]": joined(" / ", *(number(f"{name}_off", 1, "max") for name in _DEVIATION)),
            "within": share(_WITHIN),
            "median error [°]": number("rotation_deg", 2),
            "largest shift [voxels]": number("translation_voxels", 1, "max"),
        },
        rows=deviations,
    ),
)


def _median_and_largest(column: str) -> Cell:
    return joined(" / ", number(column, 1), number(column, 1, "max"))


LIMITS = (
    Table(
        "Errors of each step, and of the whole chain [degrees]: median / largest",
        ("tilted", "tilt_deg"),
        {
            **{f"{name} error": _median_and_largest(f"{name}_size") for name in _DEVIATION},
            "yaw's offset: median, least, largest": joined(
                ", ", *(number("yaw_off_deg", 1, how) for how in ("median", "min", "max"))
            ),
            "yaw within 2°": share("yaw_size <= 2", form="plain"),
            "roll and pitch within 2°": share("roll_size <= 2 and pitch_size <= 2", form="plain"),
            "the whole chain": _median_and_largest("chain_off_deg"),
            "chain within 6° and 3 voxels": share("chain_off_deg <= 6 and chain_shift_voxels <= 3"),
        },
        rows=lambda frame: frame.assign(**{f"{name}_size": frame[f"{name}_off_deg"].abs() for name in _DEVIATION}),
    ),
)


def last_right(frame: Frame, over: str, *series: str) -> list[int]:
    """The last step before the first failure of each series, in their order; -1 if the first step fails.

    `over` is the column of the steps, `series` are the columns that identify a series.
    """
    ends = []
    for _, some in frame.groupby(list(series)):
        failed = some[over][~some["right"].astype(bool)]
        ends.append(int(failed.min() if len(failed) else some[over].max() + 1) - 1)
    return ends


def step_name(step: int) -> str:
    """The name of a step, such as "S3"; "none" below 0."""
    return f"S{step}" if step >= 0 else "none"


def _last_scan(frame: Frame) -> str:
    ends = last_right(frame, "scan", "seed")
    return f"{step_name(median_low(ends))} ({' '.join(map(step_name, ends))})"


def _paper_last(frame: Frame) -> str:
    last = PAPER_LAST.get(float(frame["sigma2"].iloc[0]))
    return DASH if last is None else f"S{last}"


def _reached(frame: Frame) -> str:
    last, ends = PAPER_LAST.get(float(frame["sigma2"].iloc[0])), last_right(frame, "scan", "seed")
    return DASH if last is None else f"{sum(end >= last for end in ends)} of {len(ends)}"


_GAUSSIAN = ("grid", "sigma2")
GAUSSIAN = (
    Table(
        "The last scan before the first failure",
        _GAUSSIAN,
        {
            "paper": _paper_last,
            "ours, median (each seed)": _last_scan,
            "reached by": _reached,
            "right": share("right"),
            "accepted though wrong": count("accepted and not right"),
            "refused though right": count("right and not accepted"),
        },
    ),
    Table(
        "Which step fails first, and how accurate the right registrations are",
        _GAUSSIAN,
        {
            "first wrong: yaw / tilt / translation": joined(
                " / ", *(count(f"wrong_step == '{step}'") for step in ("yaw", "tilt", "translation"))
            ),
            "right at the scan's center": count("right_at_center"),
            "median error where right [°]": number("rotation_deg", 2, condition="right"),
            "[m]": number("translation_m", 2, condition="right"),
        },
    ),
    Table(
        "Median run times [s]",
        ("grid",),
        {
            "two preparations and one registration": lambda frame: (
                f"{2 * frame['prepare_s'].median() + frame['register_s'].median():.2f}"
            ),
            "one preparation": number("prepare_s", 2),
            "one registration": number("register_s", 2),
        },
        times=True,
    ),
)


def _by_survey(row: str, value: Callable[[Frame], float], form: str = ".2f") -> Cell:
    """A cell with a value per survey, computed from its rows of pairs or poses; a dash without such rows."""

    def cell(frame: Frame) -> str:
        some = where(frame, f"row == '{row}'")
        return DASH if some.empty else " / ".join(f"{value(rows):{form}}" for _, rows in some.groupby("seed"))

    return cell


def _last(column: str) -> Callable[[Frame], float]:
    """The value of a column at the last pose, which is that of the whole map."""
    return lambda poses: float(poses[column].iloc[-1])


def ate_m(pairs: Frame) -> float:
    """Root mean square error of a survey's positions after the best rigid alignment [m]."""
    stamps, rows = np.arange(len(pairs) + 1, dtype=np.float64), pairs.to_dict("records")
    found, true = (Trajectory(stamps, chained(rows, which)) for which in ("found", "true"))
    return evaluate(found, true).ate_m


FLOODGATE = (
    Table(
        "Maps and poses, survey by survey",
        ("method", "grid"),
        {
            "right pairs": _by_survey(PAIR, lambda pairs: int(pairs["right"].sum()), "d"),
            "within 3 m": _by_survey(PAIR, lambda pairs: len(where(pairs, "right and translation_m <= 3")), "d"),
            "accepted though wrong": _by_survey(PAIR, lambda pairs: len(where(pairs, "accepted and not right")), "d"),
            "half of the map's points within [m]": _by_survey(POSE, _last(MAP_MEDIAN)),
            "90 % within [m]": _by_survey(POSE, _last(MAP_90)),
            "90 % displaced by at most [m]": _by_survey(POSE, _last(DISPLACED_90)),
            "ATE [m]": _by_survey(PAIR, ate_m),
            "largest pose error [m]": _by_survey(POSE, lambda poses: poses["translation_m"].max()),
            "largest pose error [°]": _by_survey(POSE, lambda poses: poses["rotation_deg"].max(), ".1f"),
        },
    ),
    Table(
        "Seconds per registration, without preparing the scans",
        ("method", "grid"),
        {
            "preparing, mean": number("prepare_s", 2, "mean"),
            **{how: number("register_s", 2, how) for how in ("min", "mean", "median", "max")},
        },
        times=True,
    ),
)
