"""A scan's signature: numbers that stay nearly what they are however its points are turned and moved.

The magnitude spectrum does not see a translation, and a rotation of the scan turns its layers, which mixes the 2 l + 1
orders of each degree l among themselves, in all layers alike. Their energies, sum over m of |a[l, m]|^2, stay (Kazhdan,
Funkhouser and Rusinkiewicz 2003, Rotation Invariant Spherical Harmonic Representation of 3D Shape Descriptors), and so
do the products of two layers' orders, which say how the layers are turned against each other.
"""

import numpy as np

from sonarmap.kernels.errors import InputError

# Every second of the innermost layers: farther out the spectrum knows how a surface lies in the voxels, which a
# rotation changes, and neighbors say much the same.
_LAYERS = slice(0, 12, 2)


def signature(products: np.ndarray) -> np.ndarray:
    """What layers have in common with each other and with themselves, degree by degree.

    With e[l, r] the energy of degree l as a share of its layer's, a share since the magnitude of a layer depends on how
    much was seen rather than on what, and c[l, r, s] the correlation of the orders of two layers, -1..1:

        signature[l, r, s] = c[l, r, s] (e[l, r] e[l, s])^(1/4),  r <= s.

    Where r = s these are the roots of the shares, between which the distance is Hellinger's: fine degrees, which
    are weak, count in it too.

    Args:
        products: (degrees, L, L) of the layers, from `Harmonics.products`, of degrees 0, 2, 4 and so on. The first, a
            layer's mean, is left out.

    Returns:
        (K,) float32 in -1..1, K = (degrees - 1) n (n + 1) / 2 with n = 6 layers, or half of L where L is below 12.
    """
    if products.ndim != 3 or len(products) < 2 or products.shape[1] != products.shape[2]:
        raise InputError(f"`products` have shape {products.shape}; wanted (degrees, L, L), of 2 degrees or more")
    chosen = products[1:, _LAYERS, _LAYERS].astype(np.float64)
    if not np.isfinite(chosen).all():
        raise InputError("`products` hold numbers that are not finite; look at the volume that went in")
    energies = np.diagonal(chosen, axis1=1, axis2=2)
    faintest = np.finfo(np.float64).tiny
    shares = energies / np.maximum(energies.sum(axis=0), faintest)
    scales = shares**0.25 / np.sqrt(np.maximum(energies, faintest))
    first, second = np.triu_indices(chosen.shape[1])
    return (chosen * scales[:, :, None] * scales[:, None])[:, first, second].astype(np.float32).ravel()
