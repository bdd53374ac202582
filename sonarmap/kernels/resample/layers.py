"""Layers of a magnitude spectrum: sample them along directions and radii, or in polar coordinates, and normalize them.

A table of directions is float32 (H, W, 3): unit vectors (x, y, z) of the upper hemisphere, one per pixel, or
zero in unused pixels. Axis 0 of the unwraps runs along x and axis 1 along y.

Shifts: sampling with R gives I_R(d) = |F|(R d). The spectrum of a source b(x) = a(R x + t) is
|B|(k) = |A|(R k), so the image of the source is the image of the target with this R."""

import numpy as np
import pyopencl.array as cla

from sonarmap.kernels.device.device import Device
from sonarmap.kernels.device.launch import affine, along, lanes, launch, output, require_array, table, team
from sonarmap.kernels.errors import InputError
from sonarmap.kernels.fft.edges import row_pitch

_PIXELS_AT_ONCE = 8


def rotational_unwrap(edge: int) -> np.ndarray:
    """Directions (edge, edge, 3) float32 of the image that yaw rotates about its center (Sect. 2.5, Fig. 1).

    Pixel (i, j) has v = (i - edge/2, j - edge/2), the azimuth atan2(v_y, v_x) and the angle |v| / (edge/2) * pi/2 from
    +z. Pixels beyond pi/2 are zero vectors. With R = Rz(psi): I_R(v) = I(Rz(psi) v), the image turned by -psi.
    """
    v = np.arange(edge) - edge / 2
    vx, vy = np.meshgrid(v, v, indexing="ij")
    polar = np.hypot(vx, vy) / (edge / 2) * (np.pi / 2)
    azimuth = np.arctan2(vy, vx)
    x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
    directions = np.stack([x, y, np.cos(polar)], axis=-1)
    return np.where(polar[..., None] <= np.pi / 2, directions, 0).astype(np.float32)


def rectangular_unwrap(edge: int, axis: str) -> np.ndarray:
    """Directions (edge, edge, 3) float32 of the images that roll and pitch shift (Sect. 2.6, Fig. 4).

    With a = (i - edge/2) pi/edge along axis 0, b = (j - edge/2) pi/edge along axis 1, both -90..90 degrees:
        axis "y" (the paper's): Ry(a) Rx(-b) z = (sin a cos b, sin b, cos a cos b), poles on y;
        axis "x" (its twin):    Rx(-b) Ry(a) z = (sin a, cos a sin b, cos a cos b), poles on x.
    With R = Ry(pitch), on "y" exactly and near the center of "x": I_R[i] = I[i + pitch edge/pi].
    With R = Rx(roll), on "x" exactly and near the center of "y": I_R[j] = I[j - roll edge/pi].
    So with target I and source I_R, a `Pomf` peaks at (+pitch, -roll) edge/pi on both. Past the end of its
    exact axis an image continues with the other axis mirrored (|F|(k) = |F|(-k)), not cyclically.

    Args:
        axis: "x" or "y", the axis of the poles.

    Returns:
        (edge, edge, 3) float32.
    """
    angle = (np.arange(edge) - edge / 2) * (np.pi / edge)
    a, b = np.meshgrid(angle, angle, indexing="ij")
    if axis == "y":
        x, y = np.sin(a) * np.cos(b), np.sin(b)
    elif axis == "x":
        x, y = np.sin(a), np.cos(a) * np.sin(b)
    else:
        raise InputError(f"`axis={axis}`; wanted 'x' or 'y', the axis of the poles")
    return np.stack([x, y, np.cos(a) * np.cos(b)], axis=-1).astype(np.float32)


def valid_pixels(directions: np.ndarray) -> np.ndarray:
    """Mask (H, W) float32 of a table of directions: 1 at its unit vectors, 0 at its zero vectors."""
    return np.asarray(directions.any(axis=-1), np.float32)


def upload_directions(device: Device, directions: np.ndarray) -> cla.Array:
    """Upload a table of directions (H, W, 3), unit vectors or zero, H W a multiple of 8, for `sample`: (3, H, W)
    float32."""
    if directions.ndim != 3 or directions.shape[2] != 3 or directions[..., 0].size % _PIXELS_AT_ONCE:
        raise InputError(
            f"`directions` have shape {directions.shape}; wanted (H, W, 3), H W a multiple of {_PIXELS_AT_ONCE}"
        )
    length = np.linalg.norm(directions, axis=-1)
    if not (np.isclose(length, 1, atol=1e-5) | (length == 0)).all():
        raise InputError("a table of directions holds unit vectors and zero vectors; normalize it first")
    return device.to_device(np.moveaxis(directions, -1, 0).astype(np.float32))


def sample(
    device: Device,
    magnitude: cla.Array,
    directions: cla.Array,
    radii: np.ndarray,
    R: np.ndarray | None = None,
    out: cla.Array | None = None,
) -> cla.Array:
    """Trilinear samples of |F| at radius (R direction), with |F|(k) = |F|(-k) below the plane k_z = 0.

    Args:
        magnitude: (edge, edge, edge/2 + 1) float32, as `spectrum.magnitude` gives it.
        directions: (3, H, W) float32, from `upload_directions`.
        radii: (L,), in [0, edge/2 - 1) [frequency bins].
        R: (3, 3) rotation of the directions; None for none.

    Returns:
        (L, H, W) float32, 0 where the direction is zero.
    """
    edge = magnitude.shape[0]
    require_array(magnitude, "magnitude", (edge, edge, edge // 2 + 1))
    _, height, width = require_array(directions, "directions", (3, None, None))
    radii = np.asarray(radii, np.float32)
    if radii.ndim != 1 or not len(radii) or not (radii.min() >= 0 and radii.max() < edge / 2 - 1):
        raise InputError(f"`radii` are {radii}; wanted a list of numbers from 0 to below {edge // 2 - 1} bins")
    if len(radii) * height * width >= 2**31:
        raise InputError(f"{len(radii)} layers of {height} x {width} are too many samples; use fewer `radii`")
    result = output(device, out, "out", (len(radii), height, width))
    pixels = height * width
    sizes = np.int32(len(radii)), np.int32(pixels)
    arrays = magnitude, directions, table(device, radii), result
    # a CPU finds a pixel's next radius close to the last in memory
    size = (pixels // lanes(device), along(device, len(radii)))
    launch(
        device, "resample/sphere", "sample", size, *arrays, *sizes, affine(R), group="columns", EDGE=edge
    )  # fmt: skip
    return result


def polar_magnitude(
    device: Device,
    spectrum: cla.Array,
    shape: tuple[int, int],
    radii: np.ndarray,
    angles: np.ndarray,
    out: cla.Array | None = None,
) -> cla.Array:
    """Bilinear samples of |F| at (radius cos angle, radius sin angle), axis 0 of the images being x.

    An image I turned by -psi, I_R(v) = I(Rz(psi) v), has |F_R|(k) = |F|(Rz(psi) k): its samples at an angle
    are those of I at the angle + psi. With angles k pi / K, k = 0..K-1, which cover the spectrum of a real
    image, the samples are cyclic, and a `Pomf` of target I and source I_R peaks at +psi K / pi, for psi
    modulo 180 degrees.

    Args:
        spectrum: (L, H, P) complex64, P = `row_pitch(W)`, of L real images by a batched transform.
        shape: (H, W) of the images, even.
        radii: (M,), from 0 to below half the shorter edge less 1 [frequency bins]; on an image that is not
            square a bin of axis 0 and one of axis 1 are not the same frequency.
        angles: (K,) [rad], from axis 0 towards axis 1; M K is a multiple of 8.

    Returns:
        (L, M, K) float32.
    """
    height, width = shape
    layers, _, pitch = require_array(spectrum, "spectrum", (None, height, row_pitch(width)), np.complex64)
    points = _frequencies(radii, angles, min(shape) // 2)
    result = output(device, out, "out", (layers, len(radii), len(angles)))
    samples = points[0].size
    sizes = np.int32(layers), np.int32(samples), np.int32(height), np.int32(pitch)
    arrays = spectrum, table(device, points), result
    size = (samples // lanes(device), layers)
    launch(device, "resample/polar", "polar_magnitude", size, *arrays, *sizes, group="columns")
    return result


def _frequencies(radii: np.ndarray, angles: np.ndarray, nyquist: int) -> np.ndarray:
    """Positions (2, M, K) float32 of the samples along axes 0 and 1 [frequency bins]."""
    radii, angles = np.asarray(radii, np.float64), np.asarray(angles, np.float64)
    if radii.ndim != 1 or not len(radii) or not (radii.min() >= 0 and radii.max() < nyquist - 1):
        raise InputError(f"`radii` are {radii}; wanted a list of numbers from 0 to below {nyquist - 1} bins")
    samples = len(radii) * angles.size
    if angles.ndim != 1 or not samples or samples % 8 or not np.isfinite(angles).all():
        raise InputError(f"{len(radii)} `radii` by {angles.size} `angles`; wanted a multiple of 8 samples in all")
    return np.stack([np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))]).astype(np.float32)


def normalize_layers(
    device: Device,
    stack: cla.Array,
    window: cla.Array | None,
    mask: cla.Array | None = None,
    out: cla.Array | None = None,
) -> cla.Array:
    """Normalize each layer to mean 0 and standard deviation 1, and multiply it by the window.

    Args:
        stack: (L, H, W) float32, finite where the mask is 1; W a multiple of 8.
        window: (H, W) float32 factors on the normalized layers; None for none.
        mask: (H, W) float32, 1 for the pixels that count for mean and deviation, 0 for pixels that
            become 0 (the zero vectors of an unwrap, `valid_pixels`); None: all count.
        out: (L, H, W) float32 to write to; may be the stack itself.

    Returns:
        (L, H, W) float32. A constant layer gives zeros.
    """
    layers, height, width = require_array(stack, "stack", (None, None, None))
    if width % 8:
        raise InputError(f"`stack` has layers {width} pixels wide; wanted a multiple of 8")
    if window is None or mask is None:
        ones = table(device, np.ones((height, width), np.float32))
        window, mask = ones if window is None else window, ones if mask is None else mask
    require_array(window, "window", (height, width))
    require_array(mask, "mask", (height, width))
    result = output(device, out, "out", (layers, height, width))
    rows, scales = device.empty((layers * height, 3)), device.empty((layers, 2))
    sizes = np.int32(height), np.int32(width)
    together = team(device)
    moments = (layers * height * together,), stack, mask, rows, *sizes
    launch(device, "resample/layers", "row_moments", *moments, group="sums")
    launch(device, "resample/layers", "layer_moments", (layers * together,), rows, scales, sizes[0], group="sums")
    size, arguments = (along(device, width), height, layers), (stack, mask, window, scales, result)
    launch(device, "resample/layers", "apply", size, *arguments, np.int32(layers), *sizes, group="rows")
    return result
