"""One registration of Table 1 as a row, and what can be read off the row."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, PairError, pair_error
from sonarmap.tools.lab.reproduce.answer import parameter_cells
from sonarmap.tools.lab.reproduce.experiment import Row
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_RIG

RANKED = 12  # so many yaw peaks are looked at


@dataclass(frozen=True, slots=True)
class ScoredRegistration:
    """A registration with its truth."""

    registration: Registration  # of the pair
    truth: RigidTransform  # the true T_target_source, between the sensor frames
    center: np.ndarray  # (3,) [m, sensor frame of the source], where the scan's grid was centered
    voxel: float  # of the grid [m]

    @property
    def error(self) -> PairError:
        """Of T_target_source, so the translation's at the sensor: it decides what is right."""
        return pair_error(self.registration.T_target_source, self.truth)

    @property
    def center_m(self) -> float:
        """How far from its true place the scan's center comes to lie [m].

        A scan's center is far from its sensor; what the rotation lacks moves one of them more than the other.
        """
        estimated = self.registration.T_target_source.apply(self.center)
        return float(np.linalg.norm(estimated - self.truth.apply(self.center)))

    @property
    def right(self) -> bool:
        """Whether it is within RIGHT_DEG and, at the sensor, RIGHT_VOXELS of the truth."""
        return self.error.within(RIGHT_DEG, RIGHT_VOXELS * self.voxel)

    @property
    def right_at_center(self) -> bool:
        """The same, the translation taken at the scan's center."""
        return self.error.rotation_deg <= RIGHT_DEG and self.center_m <= RIGHT_VOXELS * self.voxel

    @property
    def wrong_step(self) -> str:
        """The first of the paper's steps whose result is wrong: yaw, tilt or translation; "" where it is right."""
        if self.right:
            return ""
        if self.error.rotation_deg <= RIGHT_DEG:
            return "translation"
        both = self.registration.T_target_source, self.truth
        estimated, true = (T.rotation.as_euler("ZYX", degrees=True)[0] for T in both)
        return "yaw" if abs(less_turns(estimated - true)) > RIGHT_DEG else "tilt"


def row_of(
    scored: ScoredRegistration, pair: tuple[str, float, int, int], method: str, edge: int, yaw_rank: int = 0
) -> Row:
    """The row of S`scan` registered to the reference scan.

    Its cells "found_..." and "true_..." are Table 1's parameters, about the grid's center.

    Args:
        scored: a registration with its truth.
        pair: scene, variance of the noise [m^2], seed and number of the scan, see `table1_pair`.
        method: a key of VARIANTS.
        edge: voxels per edge.
        yaw_rank: the place of the right yaw among the RANKED highest yaw peaks of the first step, 1 for the highest;
            0 where it is not among them. It depends on how the scans were prepared, not on what followed.
    """
    scene, sigma2, seed, scan = pair
    registration, error, steps = scored.registration, scored.error, dict(scored.registration.step_psr)
    return {
        **{"scene": scene, "grid": edge, "voxel_m": scored.voxel, "sigma2": sigma2, "seed": seed, "scan": scan},
        **{"method": method, "right": scored.right, "wrong_step": scored.wrong_step},
        "rotation_deg": error.rotation_deg,
        "translation_m": error.translation_m,
        "translation_voxels": error.translation_m / scored.voxel,
        "center_m": scored.center_m,
        "right_at_center": scored.right_at_center,
        "yaw_rank": yaw_rank,
        "accepted": bool(registration.accepted),
        "psr": float(registration.psr),
        **{f"{step}_psr": float(steps[step]) for step in ("rival", "yaw", "tilt")},
        "overlap": float(registration.overlap),
        **parameter_cells(about_center(registration.T_target_source), "found"),
        **parameter_cells(about_center(scored.truth), "true"),
    }


def about_center(T_target_source: RigidTransform) -> RigidTransform:
    """A transform between sensor frames, as one about the grid's center: there Table 1 states its values."""
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    return T_grid_rig * T_target_source * T_grid_rig.inv()


def less_turns(angle: float) -> float:
    """An angle without its whole turns [degrees], -180..180."""
    return (angle + 180) % 360 - 180


def yaw_error(row: Row) -> float:
    """Of the yaw alone [degrees], -180..180."""
    return less_turns(float(row["found_yaw_deg"]) - float(row["true_yaw_deg"]))


def tilt_error(row: Row) -> float:
    """The angle between the verticals, which roll and pitch alone decide [degrees]."""
    angles = [[float(row[f"{which}_{name}_deg"]) for name in ("pitch", "roll")] for which in ("found", "true")]
    up = Rotation.from_euler("YX", angles, degrees=True).inv().apply([0.0, 0.0, 1.0])
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(up[0], up[1])), up[0] @ up[1])))
