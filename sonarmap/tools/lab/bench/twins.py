"""The twins of the kernels: the same work by NumPy and SciPy, in single precision.

FFTs and resampling use `cores` threads; elementwise operations of NumPy use one.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import scipy.fft
from scipy.ndimage import map_coordinates, maximum_filter
from scipy.spatial import KDTree

_FLOOR = 1e-9  # magnitudes up to it are whitened to 0


def forward(volume: np.ndarray, cores: int) -> np.ndarray:
    """The half spectrum of a real volume."""
    return np.asarray(scipy.fft.rfftn(volume, workers=cores))


def inverse(spectrum: np.ndarray, cores: int) -> np.ndarray:
    """The real (N, N, N) volume of a half spectrum (N, N, N/2 + 1)."""
    return np.asarray(scipy.fft.irfftn(spectrum, s=(spectrum.shape[0],) * 3, workers=cores))


def voxelize(points: np.ndarray, R: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Overwrite `volume` (N, N, N) float32 with the largest weight in each voxel; points (n, 4) float32."""
    edge = volume.shape[0]
    cells = np.floor(points[:, :3] @ R.T.astype(np.float32) + np.float32(edge / 2 + 0.5)).astype(np.int32)
    inside = ((cells >= 0) & (cells < edge)).all(axis=1)
    i, j, k = cells[inside].T
    volume.fill(0)
    np.maximum.at(volume.reshape(-1), (i * edge + j) * edge + k, points[inside, 3])
    return volume


def magnitude(spectrum: np.ndarray) -> np.ndarray:
    """|F| of a half spectrum, centered in axes 0 and 1."""
    return scipy.fft.fftshift(np.abs(spectrum), axes=(0, 1))


def whiten(spectrum: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Write F / |F| into `out`, 0 where |F| is tiny."""
    size = np.abs(spectrum)
    size[size <= _FLOOR] = np.inf
    return np.divide(spectrum, size, out=out)


def cross_power(target: np.ndarray, source: np.ndarray, blur: float, out: np.ndarray) -> np.ndarray:
    """Write target conj(source) of half spectra of cubes into `out`, blurred by a Gaussian [voxels]."""
    edge = target.shape[0]
    gain = np.exp(-2 * (np.pi * blur * np.fft.fftfreq(edge)) ** 2).astype(np.float32)
    np.conj(source, out=out)
    out *= target
    out *= np.multiply.outer(gain, gain)[:, :, None]
    out *= gain[: edge // 2 + 1]
    return out


def prepare(volume: np.ndarray, cores: int) -> np.ndarray:
    """The whitened half spectrum of a real volume."""
    spectrum = forward(volume, cores)
    return whiten(spectrum, spectrum)


def correlate(target: np.ndarray, source: np.ndarray, blur: float, scratch: np.ndarray, cores: int) -> np.ndarray:
    """The correlation of two whitened half spectra of cubes."""
    return inverse(cross_power(target, source, blur, scratch), cores)


def peak(correlation: np.ndarray) -> np.ndarray:
    """(32,): index (3), value, peak-to-sidelobe ratio and neighborhood (27) of the highest voxel."""
    index = np.array(np.unravel_index(np.argmax(correlation), correlation.shape))
    mean, std = correlation.mean(dtype=np.float64), correlation.std()
    around = np.ix_(*((i + np.arange(-1, 2)) % n for i, n in zip(index, correlation.shape, strict=True)))
    cube = correlation[around]
    return np.concatenate([index, [cube[1, 1, 1], (cube[1, 1, 1] - mean) / std], cube.ravel()])


def sample(magnitude: np.ndarray, directions: np.ndarray, radii: np.ndarray, R: np.ndarray, cores: int) -> np.ndarray:
    """(L, H, W): |F| at radius (R direction), directions (H, W, 3), |F| centered in axes 0 and 1."""
    turned = np.moveaxis(directions @ R.T.astype(np.float32), -1, 0)
    turned = np.where(turned[2] < 0, -turned, turned)
    center = np.array([magnitude.shape[0] / 2, magnitude.shape[1] / 2, 0], np.float32)[:, None, None]
    out = np.empty((len(radii), *directions.shape[:2]), np.float32)

    def layer(n: int) -> None:
        map_coordinates(magnitude, turned * radii[n] + center, output=out[n], order=1)

    _spread(layer, len(radii), cores)
    return out


def normalize_layers(stack: np.ndarray, window: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(L, H, W): each layer minus its mean, over its standard deviation, times the window, all under the mask."""
    # np.take keeps rows contiguous, so that NumPy sums them pairwise and keeps its precision
    inside = np.take(stack.reshape(len(stack), -1), np.flatnonzero(mask), axis=1)
    mean, std = inside.mean(axis=1), inside.std(axis=1)
    out = stack - mean[:, None, None]
    out /= std[:, None, None]
    out *= window * mask
    return out


def polar_magnitude(spectrum: np.ndarray, radii: np.ndarray, angles: np.ndarray, cores: int) -> np.ndarray:
    """(L, M, K): |F| of half spectra (L, H, W/2 + 1) at radii (M,) and angles (K,) within 0..pi."""
    points = np.stack([np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))]).astype(np.float32)
    points[0] += np.float32(spectrum.shape[1] // 2)
    out = np.empty((len(spectrum), len(radii), len(angles)), np.float32)

    def layer(n: int) -> None:
        map_coordinates(scipy.fft.fftshift(np.abs(spectrum[n]), axes=0), points, output=out[n], order=1)

    _spread(layer, len(spectrum), cores)
    return out


def correlate_rotations(
    target: np.ndarray, source: np.ndarray, wigner: np.ndarray, edge: int, cores: int
) -> np.ndarray:
    """The correlation over rotations (betas + 1, edge, edge), its last image 0, from (degrees, L, 2 bandwidth - 1)
    coefficients; the last axis of `wigner` (degrees, betas, 2 bandwidth - 1, bandwidth) starts at order 0."""
    bandwidth = wigner.shape[3]
    products = target.transpose(0, 2, 1) @ source[:, :, bandwidth - 1 :].conj()
    spectrum = np.zeros((wigner.shape[1] + 1, edge, edge // 2 + 1), np.complex64)
    rows = np.arange(1 - bandwidth, bandwidth) % edge
    spectrum[:-1, rows, :bandwidth] = np.einsum("lbmn,lmn->bmn", wigner, products)
    return np.asarray(scipy.fft.irfft2(spectrum, s=(edge, edge), norm="forward", workers=cores))


def segment_peaks(correlation: np.ndarray, segments: int, images: int) -> np.ndarray:
    """(m, 4): index and value of the highest local maximum in each segment of each row of the first `images` images,
    highest first."""
    values = np.where(correlation == maximum_filter(correlation, 3, mode="wrap"), correlation, -np.inf)
    parts = values.reshape(*correlation.shape[:2], segments, -1)
    columns = parts.argmax(axis=3)
    highest = np.take_along_axis(parts, columns[..., None], axis=3)[..., 0]
    i, j, part = np.nonzero(highest[:images] > -np.inf)
    rows = np.column_stack([i, j, part * parts.shape[3] + columns[i, j, part], highest[i, j, part]])
    return rows[np.argsort(-rows[:, 3], kind="stable")]


def nearest(tree: KDTree, points: np.ndarray, R: np.ndarray, t: np.ndarray, cores: int) -> np.ndarray:
    """(m,) distances of the points (m, 3), moved by R and t, to the nearest point of the tree."""
    return np.asarray(tree.query(points @ R.T.astype(np.float32) + t.astype(np.float32), workers=cores)[0])


def on_planes(tree: KDTree, points: np.ndarray, neighbors: int, farthest: float, cores: int) -> np.ndarray:
    """(m, 3): the points projected onto the planes of their neighbors; points beyond `farthest` are not moved."""
    around = points[np.asarray(tree.query(points, neighbors, workers=cores)[1])]
    middle = around.mean(axis=1)
    spread = around - middle[:, None]
    normals = np.linalg.eigh(spread.transpose(0, 2, 1) @ spread)[1][:, :, 0]
    height = np.einsum("ni,ni->n", points - middle, normals)
    height[np.abs(height) > farthest] = 0
    return points - height[:, None] * normals


def agreement(
    view: np.ndarray, points: np.ndarray, R: np.ndarray, t: np.ndarray, reach: float, slope: float
) -> np.ndarray:
    """(m, 3): numbers of points (n, 3) that agree, contradict, and fall into seen cells, under each of m poses."""
    counts = np.empty((len(R), 3), np.int64)
    edge = len(view)
    for n, (turn, shift) in enumerate(zip(R.astype(np.float32), t.astype(np.float32), strict=True)):
        moved = points @ turn.T + shift
        distance = np.sqrt(np.square(moved).sum(axis=1))
        x, y, z = (moved / np.abs(moved).sum(axis=1, keepdims=True)).T
        u = np.where(z < 0, (1 - np.abs(y)) * np.where(x < 0, -1, 1), x)
        v = np.where(z < 0, (1 - np.abs(x)) * np.where(y < 0, -1, 1), y)
        i, j = (np.clip(((side + 1) * (edge / 2)).astype(np.int32), 0, edge - 1) for side in (u, v))
        near, far = view[i, j].T
        tolerance = reach + slope * distance
        seen, before = far >= 0, distance < near - tolerance
        counts[n] = (seen & ~before & (distance <= far + tolerance)).sum(), (seen & before).sum(), seen.sum()
    return counts


def _spread(work: Callable[[int], None], count: int, cores: int) -> None:
    """Call work(0..count-1) on threads: scipy.ndimage is single-threaded, but releases the GIL."""
    with ThreadPoolExecutor(cores) as pool:
        for _ in pool.map(work, range(count)):
            pass
