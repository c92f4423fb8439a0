"""Simulated vector observations with known attitudes."""

import numpy as np
from scipy.spatial.transform import Rotation


def epochs(rng, size, count=2, apart=None, noise=0.0, rotation=None):
    """Measured and reference unit vectors (size, count, 3) and true matrices (size, 3, 3).

    The first two reference vectors are `apart` (rad) where given; `noise` is added to each component
    of the measured vectors, rad.
    """
    reference = unit(rng.normal(size=(size, count, 3)))
    if apart is not None:
        across = unit(np.cross(reference[:, 0], rng.normal(size=(size, 3))))
        reference[:, 1] = np.cos(apart) * reference[:, 0] + np.sin(apart) * across
    rotation = Rotation.random(size, rng=rng) if rotation is None else rotation
    true = np.swapaxes(rotation.as_matrix(), -1, -2)  # scipy's is active
    measured = reference @ np.swapaxes(true, -1, -2)
    return unit(measured + noise * rng.normal(size=measured.shape)), reference, true


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def aligned(measured, reference, weights):
    """scipy's align_vectors, epoch by epoch, as direction-cosine matrices."""
    found = [
        Rotation.align_vectors(g, r, w)[0].as_matrix()
        for g, r, w in zip(measured, reference, weights, strict=True)
    ]
    return np.array(found)


def angle(one, other):
    """The angle between two batches of attitudes, rad, by the chord of the matrices' difference."""
    chord = np.linalg.norm(one - other, axis=(-2, -1)) / np.sqrt(8)  # sin(angle / 2)
    return 2 * np.arcsin(np.minimum(chord, 1))
