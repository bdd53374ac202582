"""Every kernel's case; a new one is a new line here."""

from collections.abc import Callable

from sonarmap.tools.lab.bench.case import KernelCase
from sonarmap.tools.lab.bench.cases import correlators, resampling, rotations, spectra, surfaces, transforms
from sonarmap.tools.lab.bench.workload import Workload

CASES: tuple[Callable[[Workload], KernelCase], ...] = (
    transforms.copy_case,
    transforms.real_forward_case,
    transforms.real_inverse_case,
    resampling.voxelize_case,
    spectra.magnitude_case,
    spectra.whiten_case,
    spectra.cross_power_case,
    spectra.prepare_case,
    spectra.correlate_case,
    spectra.find_peaks_case,
    resampling.sample_case,
    resampling.normalize_layers_case,
    resampling.polar_magnitude_case,
    rotations.correlate_rotations_case,
    rotations.rotation_peaks_case,
    rotations.agreement_case,
    correlators.find_case,
    correlators.near_case,
    surfaces.nearest_case,
    surfaces.planes_case,
)
