"""One registration of Table 1 as a row, and what can be read off the row."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, Self

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.evaluate.trajectory import RIGHT_DEG, RIGHT_VOXELS, PairError, pair_error
from sonarmap.tools.lab.reproduce.answer import parameter_cells
from sonarmap.tools.lab.reproduce.experiment import Row, Value
from sonarmap.tools.lab.simulate.paths.trajectories import TABLE1_RIG

RANKED = 12  # so many yaw peaks are looked at


@dataclass(frozen=True, slots=True)
class _Cells:
    """A row whose columns are its fields."""

    @classmethod
    def of(cls, cells: Row) -> Self:
        """From what `cells` gave."""
        values: Mapping[str, Any] = cells
        return cls(**values)

    def cells(self) -> Row:
        """As the CSV has it."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class GaussianRow(_Cells):
    """S`scan` registered to the reference scan, by one method.

    Attributes:
        scene: a key of SCENE_KINDS.
        grid, voxel_m: voxels per edge, and the edge of one [m].
        sigma2, seed, scan: which pair, see `table1_pair`.
        method: a key of VARIANTS.
        right, wrong_step, right_at_center: see `ScoredRegistration`.
        rotation_deg, translation_m, translation_voxels: errors of T_target_source between the sensor frames.
        center_m: the translation's error at the center of the scan's grid [m].
        yaw_rank: the place of the right yaw among the RANKED highest yaw peaks of the first step, 1 for the highest;
            0 where it is not among them. It depends on how the scans were prepared, not on what followed.
        accepted, psr, rival_psr, yaw_psr, tilt_psr, overlap: what the registration says of itself.
        found_..., true_...: Table 1's parameters, about the grid's center.
    """

    scene: str
    grid: int
    voxel_m: float
    sigma2: float
    seed: int
    scan: int
    method: str
    right: bool
    wrong_step: str
    rotation_deg: float
    translation_m: float
    translation_voxels: float
    center_m: float
    right_at_center: bool
    yaw_rank: int
    accepted: bool
    psr: float
    rival_psr: float
    yaw_psr: float
    tilt_psr: float
    overlap: float
    found_x_m: float
    found_y_m: float
    found_z_m: float
    found_yaw_deg: float
    found_roll_deg: float
    found_pitch_deg: float
    true_x_m: float
    true_y_m: float
    true_z_m: float
    true_yaw_deg: float
    true_roll_deg: float
    true_pitch_deg: float

    @property
    def pair(self) -> tuple[int, float, int, int]:
        """Grid, noise, seed and scan: what all methods have in common."""
        return self.grid, self.sigma2, self.seed, self.scan

    @property
    def found(self) -> np.ndarray:
        """(6,) x, y, z [m], yaw, roll, pitch [degrees] as Table 1 lists them."""
        angles = (self.found_yaw_deg, self.found_roll_deg, self.found_pitch_deg)
        return np.array([self.found_x_m, self.found_y_m, self.found_z_m, *angles])

    @property
    def true(self) -> np.ndarray:
        """(6,) the same of the truth."""
        angles = (self.true_yaw_deg, self.true_roll_deg, self.true_pitch_deg)
        return np.array([self.true_x_m, self.true_y_m, self.true_z_m, *angles])

    @property
    def yaw_error_deg(self) -> float:
        """Of the yaw alone [degrees], 0..180."""
        return abs((self.found_yaw_deg - self.true_yaw_deg + 180) % 360 - 180)

    @property
    def tilt_error_deg(self) -> float:
        """The angle between the verticals, which roll and pitch alone decide [degrees]."""
        angles = [[row[5], row[4]] for row in (self.found, self.true)]
        up = Rotation.from_euler("YX", angles, degrees=True).inv().apply([0.0, 0.0, 1.0])
        return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(up[0], up[1])), up[0] @ up[1])))


@dataclass(frozen=True, slots=True)
class GaussianTime(_Cells):
    """How long one registration took.

    Attributes:
        grid, sigma2, seed, scan, method: which.
        prepare_s: preparing S`scan` [s]; methods that prepare alike share it.
        register_s: registering it, both scans being prepared [s].
    """

    grid: int
    sigma2: float
    seed: int
    scan: int
    method: str
    prepare_s: float
    register_s: float


@dataclass(frozen=True, slots=True)
class ScoredRegistration:
    """A registration with its truth.

    Attributes:
        registration: of the pair.
        truth: the true T_target_source, between the sensor frames.
        center: (3,) [m, sensor frame of the source], where the scan's grid was centered.
        voxel: of the grid [m].
    """

    registration: Registration
    truth: RigidTransform
    center: np.ndarray
    voxel: float

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
    def wrong_step(self) -> Literal["", "yaw", "tilt", "translation"]:
        """The first of the paper's steps whose result is wrong; "" where it is right."""
        if self.right:
            return ""
        if self.error.rotation_deg <= RIGHT_DEG:
            return "translation"
        estimated, true = (T.rotation.as_euler("ZYX", degrees=True) for T in (self._found, self.truth))
        yaw = (estimated[0] - true[0] + 180) % 360 - 180
        return "yaw" if abs(yaw) > RIGHT_DEG else "tilt"

    @property
    def _found(self) -> RigidTransform:
        return self.registration.T_target_source


def row_of(
    scored: ScoredRegistration, pair: tuple[str, float, int, int], method: str, edge: int, yaw_rank: int = 0
) -> GaussianRow:
    """The row of a scored registration.

    Args:
        scored: a registration with its truth.
        pair: scene, variance of the noise [m^2], seed and number of the scan.
        method: a key of VARIANTS.
        edge: voxels per edge.
        yaw_rank: see `GaussianRow`.
    """
    scene, sigma2, seed, scan = pair
    registration, error, steps = scored.registration, scored.error, dict(scored.registration.step_psr)
    cells: dict[str, Value] = {"scene": scene, "grid": edge, "voxel_m": scored.voxel}
    cells |= {"sigma2": sigma2, "seed": seed, "scan": scan, "method": method}
    cells |= {"right": scored.right, "wrong_step": scored.wrong_step, "right_at_center": scored.right_at_center}
    cells |= {"yaw_rank": yaw_rank}
    cells |= {"rotation_deg": error.rotation_deg, "translation_m": error.translation_m}
    cells |= {"translation_voxels": error.translation_m / scored.voxel, "center_m": scored.center_m}
    cells |= {"accepted": bool(registration.accepted), "overlap": float(registration.overlap)}
    cells |= {"psr": float(registration.psr), "rival_psr": float(steps["rival"])}
    cells |= {"yaw_psr": float(steps["yaw"]), "tilt_psr": float(steps["tilt"])}
    for which, T in (("found", registration.T_target_source), ("true", scored.truth)):
        cells |= parameter_cells(about_center(T), which)
    return GaussianRow.of(cells)


def about_center(T_target_source: RigidTransform) -> RigidTransform:
    """A transform between sensor frames, as one about the grid's center: there Table 1 states its values."""
    T_grid_rig = RigidTransform.from_translation(TABLE1_RIG)
    return T_grid_rig * T_target_source * T_grid_rig.inv()


Step = Literal["", "yaw", "tilt", "translation"]
