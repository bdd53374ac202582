"""The files that the experiment on Table 1 leaves: every registration, the page, the figure."""

from pathlib import Path

from tools.atomic import all_or_none, atomic_path
from tools.reproduce.gaussian import GaussianResult, GaussianRow, GaussianSettings
from tools.reproduce.gaussian_figure import ROTATION, TRANSLATION, draw_gaussian, parameters
from tools.reproduce.gaussian_page import gaussian_page
from tools.reproduce.table import write_csv

_PARAMETERS = (*(f"{name}_m" for name in TRANSLATION), *(f"{name}_deg" for name in ROTATION))

# Parameters are about the grid's center, as in Table 1; rotation_deg, translation_m and translation_voxels are
# errors of T_target_source between sensor frames, center_m is the translation's at the scan's center.
COLUMNS = (
    *("scene", "grid", "voxel_m", "sigma2", "seed", "scan", "method"),
    *("right", "wrong_step", "rotation_deg", "translation_m", "translation_voxels", "center_m"),
    *("accepted", "psr", "rival_psr", "yaw_psr", "tilt_psr", "overlap"),
    *(f"found_{name}" for name in _PARAMETERS),
    *(f"true_{name}" for name in _PARAMETERS),
    "seconds",  # last: the only column that differs between two runs
)


def write_gaussian(folder: Path, result: GaussianResult) -> list[Path]:
    """Write gaussian.csv, gaussian.png and gaussian.md: all of them or, where one cannot be written, none.

    Raises:
        InputError: a file cannot be written.
    """
    rows, picture, page = (folder / f"gaussian.{suffix}" for suffix in ("csv", "png", "md"))
    with all_or_none():
        write_csv(rows, COLUMNS, (_cells(row, result.settings) for row in result.rows))
        draw_gaussian(picture, result)
        with atomic_path(page) as temporary:
            temporary.write_text(gaussian_page(result, picture.name, rows.name), encoding="utf-8")
    return [rows, picture, page]


def _cells(row: GaussianRow, settings: GaussianSettings) -> list[object]:
    trial, registration, grid = row.trial, row.trial.registration, settings.grid
    error, steps = trial.error, dict(registration.step_psr)
    return [
        *(settings.scene, grid.edge, grid.voxel, row.sigma2, row.seed, f"S{row.index}", row.method),
        *(trial.right, trial.wrong_step, error.rotation_deg, error.translation_m),
        *(error.translation_m / grid.voxel, trial.center_m),
        *(registration.accepted, registration.psr, steps["rival"], steps["yaw"], steps["tilt"]),
        registration.overlap,
        *parameters(registration.T_target_source).tolist(),
        *parameters(trial.truth).tolist(),
        registration.seconds,
    ]
