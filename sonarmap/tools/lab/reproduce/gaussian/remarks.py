"""Which step of Table 1's registrations fails first, and what the rows show about the reason."""

from collections.abc import Sequence
from statistics import median

from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG
from sonarmap.tools.lab.reproduce.gaussian.row import RANKED, GaussianRow
from sonarmap.tools.lab.reproduce.gaussian.summary import FEW, among

# Structure fixed to the sensor or to the grid has its false yaw peaks at multiples of a quarter turn.
_QUARTERS = 4
_NEAR_DEG = 15.0
_BY_CHANCE = _QUARTERS * 2 * RIGHT_DEG / 360


def remarks(rows: Sequence[GaussianRow]) -> str:
    """One paragraph for each grid and method that fails anywhere."""
    cases = dict.fromkeys((row.grid, row.method) for row in rows)
    paragraphs = [_paragraph(grid, method, rows) for grid, method in cases]
    return "\n".join(f"- {paragraph}" for paragraph in paragraphs)


def _paragraph(grid: int, method: str, rows: Sequence[GaussianRow]) -> str:
    mine = [row for row in rows if (row.grid, row.method) == (grid, method)]
    steps = {step: [row for row in mine if row.wrong_step == step] for step in ("yaw", "tilt", "translation")}
    wrong = sum(len(rows_of_step) for rows_of_step in steps.values())
    where = f"**{grid}³, {method}**: "
    if not wrong:
        return f"{where}all {len(mine)} registrations are right."
    counts = ", ".join(f"{step} in {len(rows_of_step)}" for step, rows_of_step in steps.items() if rows_of_step)
    sentences = [f"{where}{wrong} of {len(mine)} registrations are wrong. The first wrong step is {counts}."]
    if steps["yaw"]:
        sentences += [_on_yaw(steps["yaw"]), *_on_near(steps["yaw"]), *_on_others(steps["yaw"], rows)]
    if steps["tilt"]:
        sentences.append(
            f"Where roll and pitch are wrong first, the vertical is off by a median of {_median(steps['tilt'])}."
        )
    if steps["translation"]:
        sentences.append(_on_translation(steps["translation"]))
    return " ".join(sentences)


def _on_yaw(wrong: Sequence[GaussianRow]) -> str:
    """How the yaw is wrong, whether roll and pitch are right, and whether the false peak is fixed to the sensor."""
    errors = [row.yaw_error_deg for row in wrong]
    near, about = sum(error <= _NEAR_DEG for error in errors), sum(error >= 180 - _NEAR_DEG for error in errors)
    upright = sum(row.tilt_error_deg <= RIGHT_DEG for row in wrong)
    quarters = sum(_from_quarter(row.found_yaw_deg) <= RIGHT_DEG for row in wrong)
    return (
        f"Of these {len(wrong)} yaws, {near} are off by at most {_NEAR_DEG:g} degrees, {about} by 180 degrees (to "
        f"within {_NEAR_DEG:g}) and {len(wrong) - near - about} by another angle; roll and pitch are right in "
        f"{upright} of them. The number within {RIGHT_DEG:g} degrees of 0, 90, 180 or 270, where structure fixed to "
        f"the sensor or to the grid has its peaks, is {quarters} (by chance: {_BY_CHANCE:.0%}). The right yaw is the "
        f"highest peak of the first step in {among(wrong, 1)}, among its {FEW} highest in {among(wrong, FEW)} and "
        f"among its {RANKED} highest in {among(wrong, RANKED)}."
    )


def _on_near(wrong: Sequence[GaussianRow]) -> list[str]:
    """Whether yaws that are nearly right err to one side, and by how much these scans are tilted."""
    near = [row for row in wrong if row.yaw_error_deg <= _NEAR_DEG]
    if not near:
        return []
    small = sum((row.found_yaw_deg - row.true_yaw_deg + 180) % 360 < 180 for row in near)
    rolls = [abs(row.true_roll_deg) for row in near]
    return [
        f"Yaws off by at most {_NEAR_DEG:g} degrees are too small in {small} of {len(near)} cases; their median error "
        f"is {median(row.yaw_error_deg for row in near):.0f} degrees, under true rolls of {min(rolls):.0f} to "
        f"{max(rolls):.0f} degrees."
    ]


def _on_others(wrong: Sequence[GaussianRow], rows: Sequence[GaussianRow]) -> list[str]:
    """How often each other method has the right yaw where this one has not."""
    method = wrong[0].method
    pairs = {row.pair for row in wrong}
    sentences = []
    for name in dict.fromkeys(row.method for row in rows if row.method != method):
        count = sum(row.pair in pairs and row.method == name and row.yaw_error_deg <= RIGHT_DEG for row in rows)
        sentences.append(f"*{name}* has the right yaw in {count} of these {len(pairs)}.")
    return sentences


def _on_translation(wrong: Sequence[GaussianRow]) -> str:
    rotation = median(row.rotation_deg for row in wrong)
    distance = median(row.translation_m for row in wrong)
    near = sum(row.right_at_center for row in wrong)
    return (
        f"Where only the translation is wrong, the median errors are {rotation:.1f} degrees and {distance:.1f} m. "
        f"Measured at the scan's center, {near} of {len(wrong)} would be right; in these, the translation at the "
        "sensor is wrong because the sensor is far from the scan's center and the rotation is slightly off."
    )


def _from_quarter(yaw_deg: float) -> float:
    return abs((yaw_deg + 45) % 90 - 45)


def _median(rows: Sequence[GaussianRow]) -> str:
    return f"{median(row.tilt_error_deg for row in rows):.0f} degrees"
