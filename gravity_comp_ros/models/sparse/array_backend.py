"""
The products over all 3^N features on another processor, or in another precision.

Any namespace of the array API standard will do: PyTorch on a CPU or a CUDA device, CuPy, or
NumPy itself in float32. Only the halves of the dictionary move there, once; a product sends M
numbers a joint and brings 3^N back. docs/solver.md says from which size on that pays.

float32 halves the memory and the time of a product, and is exact to about 1e-6 of the largest
one. So it only proposes what enters the working set: the optimality conditions, the certificate
and the search for the support use float64 all the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.regressor import Design, EnergyDesign, TorqueDesign
import numpy as np

_PRECISIONS = ('float64', 'float32')
PlainDesign = TorqueDesign | EnergyDesign


@dataclass(frozen=True)
class Arrays:
    """
    Where and how large products are made.

    `namespace` is a module with the functions of the array API standard, e.g. `torch`, `cupy` or
    `numpy`; `device` one of its devices, e.g. `cuda`, None for its usual one; `dtype` is float64
    or float32.

    :raises OptionError: if the precision is another one.
    """

    namespace: str = 'numpy'
    dtype: str = 'float64'
    device: str | None = None

    def __post_init__(self) -> None:
        if self.dtype not in _PRECISIONS:
            raise OptionError(f'arrays: dtype is {self.dtype}; choose from '
                              f'{", ".join(_PRECISIONS)}')

    def design_type(self, plain: type[PlainDesign]) -> Callable[[FloatArray, FloatArray], Design]:
        """
        Return what makes designs of a kind whose products are made there.

        :raises OptionError: if the namespace cannot be loaded.
        """
        if self == Arrays():
            return plain
        there = _There(self)
        return lambda q, weights: DeviceDesign(plain(q, weights), there)


class _There:
    """A namespace with its device and precision, and arrays taken there and back."""

    def __init__(self, arrays: Arrays) -> None:
        self.dtype = arrays.dtype
        try:
            self.xp: Any = import_module(arrays.namespace)
        except ImportError as error:
            raise OptionError(f'arrays: the namespace {arrays.namespace} does not load here '
                              f'({error})') from None
        self._kind = getattr(self.xp, arrays.dtype)
        self._where = {} if arrays.device is None else {'device': arrays.device}

    def take(self, values: FloatArray) -> Any:
        """Return a NumPy array as one of the namespace."""
        return self.xp.asarray(np.ascontiguousarray(values), dtype=self._kind, **self._where)

    def back(self, values: Any) -> FloatArray:
        """Return an array of the namespace as one of NumPy, in float64."""
        for name in ('cpu', 'get'):       # PyTorch's and CuPy's ways home from a GPU
            if hasattr(values, name):
                values = getattr(values, name)()
        return np.asarray(np.from_dlpack(values), dtype=np.float64)


class DeviceDesign:
    """
    A design whose products with all columns are made elsewhere; the rest stays here.

    :param plain: the design in NumPy.
    """

    def __init__(self, plain: PlainDesign, there: _There,
                 halves: tuple[Any, Any] | None = None) -> None:
        self.n_rows, self.n_columns = plain.n_rows, plain.n_columns
        self._plain, self._there = plain, there
        self._halves = halves or (there.take(plain.halves.left),
                                  there.take(plain.halves.right.T))

    @property
    def precise(self) -> Design:
        return self if self._there.dtype == 'float64' else self._plain

    def reweighted(self, row_weights: FloatArray) -> DeviceDesign:
        return DeviceDesign(self._plain.reweighted(row_weights), self._there, self._halves)

    def columns(self, indices: IntArray) -> FloatArray:
        return self._plain.columns(indices)

    def squared_norms(self) -> FloatArray:
        return self._plain.squared_norms()

    def correlate(self, r: FloatArray) -> FloatArray:
        return self.correlate_many(r[:, None])[0]

    def correlate_many(self, r: FloatArray) -> FloatArray:
        if not r.shape[1]:
            return np.zeros((0, self.n_columns))
        return np.stack([self._there.back(self._correlate(one)) for one in r.T])

    def _correlate(self, r: FloatArray) -> Any:
        """Return A.T r over all columns: one product for each torque, all at once."""
        xp, (left, right) = self._there.xp, self._halves
        weighted = self._there.take(self._plain.weighted_rows(r))
        parts = xp.matmul(left, weighted[:, :, None] * right[None, :, :])
        if isinstance(self._plain, TorqueDesign):
            return xp.reshape(parts, (-1,))
        total = xp.zeros_like(xp.reshape(parts[0, ...], (-1,)))
        for n in range(self._plain.n_joints):
            features = xp.reshape(parts[n, ...], (3 ** n, 3, -1))
            sine, cosine = features[:, dictionary.SIN, :], features[:, dictionary.COS, :]
            # d sin = cos, d cos = -sin: what belongs to cos is credited to sin, and so on.
            swapped = self._concat([part[:, None, :] for part in (
                xp.zeros_like(sine), cosine, -sine)])
            total = total + xp.reshape(swapped, (-1,))
        return total

    def _concat(self, parts: list[Any]) -> Any:
        xp = self._there.xp
        if hasattr(xp, 'concat') and xp.__name__ != 'torch':
            return xp.concat(parts, axis=1)
        return xp.concatenate(parts, 1)   # PyTorch, and NumPy before 2.0
