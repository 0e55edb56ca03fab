"""Textbook references on small dense matrices for tests of the solvers."""

from gravity_comp_ros.models.sparse.regressor import Design
import numpy as np


class DenseDesign(Design):
    """A dense matrix (R, K) with the interface of a design."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix = np.asarray(matrix, dtype=float)
        self.n_rows, self.n_columns = self.matrix.shape

    def columns(self, indices):
        return self.matrix[:, indices]

    def correlate(self, r):
        return self.matrix.T @ r

    @property
    def squared_norms(self):
        return (self.matrix ** 2).sum(axis=0)


def coordinate_descent(a: np.ndarray, b: np.ndarray, penalties: np.ndarray,
                       sweeps: int = 20000) -> np.ndarray:
    """Minimise 1/2 |A x - b|^2 + sum_k p_k |x_k|, one coefficient at a time."""
    x, squares, residual = np.zeros(a.shape[1]), (a ** 2).sum(axis=0), b.copy()
    for _ in range(sweeps):
        change = 0.0
        for k in np.flatnonzero(squares):
            rho = a[:, k] @ residual + squares[k] * x[k]
            new = np.sign(rho) * max(abs(rho) - penalties[k], 0.0) / squares[k]
            residual -= a[:, k] * (new - x[k])
            change, x[k] = max(change, abs(new - x[k]) * np.sqrt(squares[k])), new
        if change < 1e-12 * max(1.0, np.linalg.norm(b)):
            break
    return x


def objective(a: np.ndarray, b: np.ndarray, penalties: np.ndarray, x: np.ndarray) -> float:
    """Return 1/2 |A x - b|^2 + sum_k p_k |x_k|."""
    return 0.5 * float(np.sum((a @ x - b) ** 2)) + float(penalties @ np.abs(x))


def breach(a: np.ndarray, b: np.ndarray, penalties: np.ndarray, x: np.ndarray) -> float:
    """Return the largest violation of the optimality conditions relative to the penalties."""
    correlation = a.T @ (b - a @ x)
    inactive = np.maximum(np.abs(correlation) - penalties, 0.0)
    active = np.abs(correlation - penalties * np.sign(x))
    return float((np.where(x == 0.0, inactive, active) / penalties).max())
