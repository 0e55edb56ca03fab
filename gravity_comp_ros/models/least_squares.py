"""
Least squares, singular values and square roots, also of rank-deficient matrices.

NumPy uses LAPACK's divide and conquer, which sometimes fails on a finite rank-deficient matrix
("SVD did not converge"). The QR iteration is then used instead. It may not end for a matrix with
NaN, so finiteness is checked first.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
import numpy as np


def lstsq(x: FloatArray, y: FloatArray, rcond: float | None = None) -> FloatArray:
    """
    Return the least-squares solution of x b = y with the smallest norm.

    :param x: (M, K). :param y: (M,) or (M, C).
    :param rcond: singular values below this share of the largest count as 0; None for the
        machine precision times the longer side of x.
    :return: b, (K,) or (K, C).
    :raises numpy.linalg.LinAlgError: if x or y is not finite.
    """
    _check_finite(x, y)
    try:
        return np.asarray(np.linalg.lstsq(x, y, rcond=rcond)[0])
    except np.linalg.LinAlgError:
        # Imported here because the node's process avoids loading SciPy.
        from scipy import linalg
        share = np.finfo(float).eps * max(x.shape) if rcond is None else rcond
        return np.asarray(linalg.lstsq(x, y, cond=share, lapack_driver='gelss')[0])


def svd(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return u (M, R), the singular values (R,) and v.T (R, K) of x (M, K), R the shorter side.

    :raises numpy.linalg.LinAlgError: if x is not finite.
    """
    _check_finite(x)
    try:
        u, size, v = np.linalg.svd(x, full_matrices=False)
    except np.linalg.LinAlgError:
        from scipy import linalg
        u, size, v = linalg.svd(x, full_matrices=False, lapack_driver='gesvd')
    return np.asarray(u), np.asarray(size), np.asarray(v)


def square_root(covariance: FloatArray) -> FloatArray:
    """Return L (K, K) with L L.T = covariance (K, K), which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _check_finite(*arrays: FloatArray) -> None:
    if not all(np.isfinite(array).all() for array in arrays):
        raise np.linalg.LinAlgError('a number of a least-squares problem is not finite')
