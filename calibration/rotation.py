"""Rotations as matrices and as vectors (axis times angle), many at a time."""

from __future__ import annotations

import numpy as np


def turn_matrix(vectors: np.ndarray) -> np.ndarray:
    """Rodrigues' formula: (..., 3) rotation vectors [rad] -> (..., 3, 3) matrices."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    K = skew(vectors)
    # sin(a)/a and (1 - cos(a))/a^2 by sinc, which is 1 at 0.
    return (
        np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (K @ K)
    )


def skew(vectors: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrices that multiply as the cross product with (..., 3) vectors."""
    K = np.zeros((*np.shape(vectors), 3))
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -z, y, -x
    K[..., 1, 0], K[..., 2, 0], K[..., 2, 1] = z, -y, x
    return K
