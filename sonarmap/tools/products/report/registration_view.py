"""What a spectral registration saw on its way, gathered from the device to be drawn."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.device.device import Array
from sonarmap.kernels.fft.transform import RealFFT
from sonarmap.kernels.points.visibility import octahedral_cells
from sonarmap.kernels.points.voxelize import voxelize
from sonarmap.kernels.pomf.spectrum import magnitude
from sonarmap.kernels.resample.sphere import rotational_unwrap, sample, upload_directions
from sonarmap.spectral.prepare.range_image import FINE, View
from sonarmap.spectral.prepare.spectral_scan import SpectralScan
from sonarmap.spectral.registration import SpectralRegistrar
from sonarmap.spectral.result import Registration
from sonarmap.spectral.translation import Translation
from sonarmap.tools.products.report.correlation_maps import (
    RotationMap,
    TranslationSlice,
    map_rotations,
    slice_translation,
)

# The layer that is shown, as a share of N/2: amid those that are correlated.
_RADIUS = 0.4
_PIXELS = 128
# A surface whose normal is nearer to the vertical than this lies rather than stands, as a bed does [cosine].
_LYING = 0.8


@dataclass(frozen=True, slots=True)
class ScanView:
    """One scan's surface."""

    name: str  # the scan's
    points: np.ndarray  # (n, 3) float64, one per occupied voxel, in the frame of the scan's sensor [m]
    normals: np.ndarray  # (n, 3) float64 of the surface there, of either sign
    contradicting: np.ndarray  # (n,) bool, whether it stands, once registered, where the other scan saw through

    def lying(self, R: Rotation) -> np.ndarray:
        """(n,) bool: which points are of a bed or a ceiling, seen in a frame turned by R."""
        return np.abs(R.apply(self.normals)[:, 2]) > _LYING


@dataclass(frozen=True, slots=True)
class RegistrationView:
    """All that is drawn."""

    registration: Registration  # the result
    # target, source: what the scans show
    target: ScanView
    source: ScanView
    spectrum: np.ndarray  # (N, N) float32, the target's magnitude spectrum at k_z = 0, centered, [i, j] at k_x and k_y
    frequency: float  # half the edge of the spectrum [1/m]
    # (2, n, n) float32, target's and source's magnitude on the hemisphere of one frequency, unwrapped about +z as the
    # paper's Fig. 1; NaN beyond the horizon.
    layers: np.ndarray
    radius: float  # that frequency [1/m]
    turns: RotationMap  # the correlation over all rotations
    followed: Rotation  # (n,) the rotations R_target_source that were verified
    shifts: TranslationSlice  # the translation's correlation under the rotation that was chosen


def view_registration(
    registrar: SpectralRegistrar, target: SpectralScan, source: SpectralScan, registration: Registration
) -> RegistrationView:
    """Look once more at each step of a registration, by the registrar that prepared the scans and registered them."""
    voxel = registrar.grid.voxel
    magnitudes = [_magnitude(registrar, scan) for scan in (target, source)]
    correlation = registrar.so3.correlate(target.coefficients, source.coefficients).get()
    return RegistrationView(
        registration=registration,
        target=_cloud(target, source, registration.T_target_source.inv(), voxel),
        source=_cloud(source, target, registration.T_target_source, voxel),
        spectrum=magnitudes[0].get()[:, :, 0],
        frequency=0.5 / voxel,
        layers=np.stack([_layer(registrar, each) for each in magnitudes]),
        radius=_RADIUS * 0.5 / voxel,
        turns=map_rotations(correlation, 2 * target.coefficients.shape[0], registrar.config.max_tilt),
        followed=registrar.rotations(target, source).R,
        shifts=_shifts(registrar, target, source, registration.T_target_source),
    )


def _cloud(scan: SpectralScan, other: SpectralScan, T_other_scan: RigidTransform, voxel: float) -> ScanView:
    points = scan.volume.center + voxel * scan.volume.surface
    across = (T_other_scan.apply(points) - other.volume.center) / voxel
    return ScanView(scan.volume.name, points, scan.surface.normals, contradicting(other.view, across))


def contradicting(view: View, points: np.ndarray) -> np.ndarray:
    """(n,) bool: which points (n, 3), about the scan's grid center [voxels], stand before what that scan saw.

    None where the scan has no viewpoint.
    """
    contradicted = np.zeros(len(points), dtype=bool)
    reach, slope = FINE
    for place, cells in zip(view.places, () if view.ranges is None else view.ranges.get(), strict=True):
        beams = points - place
        ranges = np.linalg.norm(beams, axis=1)
        nearest, farthest = cells.reshape(-1, 2)[octahedral_cells(beams, len(cells))].T
        contradicted |= (farthest >= 0) & (ranges < nearest - (reach + slope * ranges))
    return contradicted


def _magnitude(registrar: SpectralRegistrar, scan: SpectralScan) -> Array:
    """(N, N, N/2 + 1): the centered magnitude spectrum, which no prepared scan keeps."""
    device, edge = registrar.device, registrar.grid.edge
    spectrum = RealFFT(device, (edge, edge, edge)).forward(voxelize(device, scan.volume.points, edge))
    return magnitude(device, spectrum, edge)


def _layer(registrar: SpectralRegistrar, magnitudes: Array) -> np.ndarray:
    """(n, n): the magnitudes of one frequency over the directions of the upper hemisphere."""
    directions = rotational_unwrap(_PIXELS)
    radii = np.array([_RADIUS * registrar.grid.edge / 2])
    layer = sample(registrar.device, magnitudes, upload_directions(registrar.device, directions), radii)
    return np.where(directions.any(axis=-1), layer.get()[0], np.nan)


def _shifts(
    registrar: SpectralRegistrar, target: SpectralScan, source: SpectralScan, T_target_source: RigidTransform
) -> TranslationSlice:
    translation, voxel = Translation(registrar.device, registrar.grid.edge), registrar.grid.voxel
    R = T_target_source.rotation
    origin = target.volume.center - R.apply(source.volume.center)
    shift = (T_target_source.translation - origin) / voxel
    (peak,) = translation.find_at(target.volume, source.volume, Rotation.concatenate([R]), shift[None]).read()
    correlation = translation.correlations(target.volume, source.volume, R)[0].get()
    return slice_translation(correlation, peak, shift, origin, voxel)
