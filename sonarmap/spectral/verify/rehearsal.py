"""Compile the kernels of a hypothesis test in another process, while this one prepares its first scans.

PoCL compiles each kernel at its first launch, one at a time in a process, and keeps it in a folder that processes
share. The other process tests a pose on a few points, and this one finds the kernels compiled.
"""

import atexit
import subprocess
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from scipy.spatial.transform import Rotation

from sonarmap.kernels.child import command_of, environment
from sonarmap.kernels.device.device import Device, choose_device
from sonarmap.kernels.device.source import are_new
from sonarmap.kernels.device.threads import thread_count
from sonarmap.kernels.fft.edges import row_pitch
from sonarmap.kernels.surface.cells import sort_into_cells
from sonarmap.spectral.memory import memory_plan
from sonarmap.spectral.prepare.range_image import FINE, scan_view, visibility
from sonarmap.spectral.prepare.spectral_scan import CoarseVolume
from sonarmap.spectral.prepare.surface import smooth_surface
from sonarmap.spectral.translation import Translation
from sonarmap.spectral.verify.icp import Stage, Start, refine
from sonarmap.spectral.verify.verifier import SURFACE_POINTS, Verifier, shared_surfaces

_POCL = "Portable Computing Language"  # other drivers compile whole programs, and some keep none
_ROOM = 4  # pairs that the device has to have memory for; the rehearsal takes less than one


def rehearse_apart(device: Device, edge: int) -> None:
    """Start the other process if the kernels are new to a processor of PoCL with a second core and enough memory."""
    is_pocl = device.is_cpu and device.selector and device.cl_device.platform.name == _POCL
    is_roomy = device.memory >= _ROOM * memory_plan(edge).pair
    if not (is_pocl and is_roomy and thread_count() > 1 and are_new(device.cl_device)):
        return
    nowhere = subprocess.DEVNULL
    with suppress(OSError):  # without the process, this one compiles all kernels
        process = subprocess.Popen(
            command_of(__name__, device.selector, str(edge)),
            stdin=nowhere,
            stdout=nowhere,
            stderr=nowhere,
            env=environment(),
        )
        atexit.register(process.kill)


def main(arguments: Sequence[str]) -> None:
    """In the other process: launch the kernels of a test on the device and the edge that are named.

    The first process compiles in the order of a test. This one ends with the kernels that the first reaches soonest, so
    that the two never compile the same kernels at the same time.
    """
    device, edge = choose_device(arguments[0]), int(arguments[1])
    _rehearse_surfaces(device)
    verifier, here, place = Verifier(device, edge), Rotation.identity(1), np.zeros((1, 3))
    coarse, fine = (_flat(translation) for translation in (verifier.coarse, verifier.translation))
    verifier.coarse.find_within(coarse, coarse, here, [None], 1, 1.0)
    verifier.translation.find_at(fine, fine, here, place).read()
    verifier.coarse.find_at(coarse, coarse, here, place).read()
    verifier.coarse.profile(coarse, coarse, here[0], place).read()
    verifier.translation.find_within(fine, fine, here, [None], 1, 1.0)


def _rehearse_surfaces(device: Device) -> None:
    """Smooth a surface, refine a pose of it to itself, and observe that pose."""
    points, here = np.random.default_rng(0).uniform(-9, 9, (300, 3)), np.zeros((1, 3))
    surface = smooth_surface(device, sort_into_cells(device, points), [here[0]]).read()
    start = Start(Rotation.identity(1), here, np.zeros(1))
    poses = refine(device, surface, surface, start, [Stage((3.0, 1.5), 100)]).poses
    view = scan_view(device, points, points, np.zeros_like(points))
    visibility(device, view, view, poses, [FINE]).read()
    shared_surfaces(device, surface, surface, poses, SURFACE_POINTS).read()


def _flat(translation: Translation) -> CoarseVolume:
    """A volume of constant spectrum, whose correlation with itself has a single peak."""
    device, edge = translation.device, translation.edge
    spectrum = device.to_device(np.ones((edge, edge, row_pitch(edge)), np.complex64))
    return CoarseVolume(device.to_device(np.ones((1, 4), np.float32)), (spectrum,) * len(translation.exponents))
