"""
Products over all 3^N features on another device or in another precision.

Supported is any namespace of the array API standard: PyTorch on a CPU or a CUDA device, CuPy, or
NumPy in float32. Only the halves of the dictionary are copied to the device, once; a product
transfers M numbers a joint there and 3^N back.

float32 halves the memory and the time of a product, with an error of about 1e-6 of the largest
one. So it only proposes candidates for the working set; the optimality conditions, the certificate
and the search for the support use float64.
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
NumpyDesign = TorqueDesign | EnergyDesign


@dataclass(frozen=True)
class Arrays:
    """
    Library, precision and device of the large products.

    `namespace` is a module with the functions of the array API standard, e.g. `torch`, `cupy` or
    `numpy`; `device` one of its devices, e.g. `cuda`, None for its default; `dtype` is float64 or
    float32.

    :raises OptionError: if `dtype` is another one.
    """

    namespace: str = 'numpy'
    dtype: str = 'float64'
    device: str | None = None

    def __post_init__(self) -> None:
        if self.dtype not in _PRECISIONS:
            raise OptionError(f'arrays: dtype is {self.dtype}; choose from '
                              f'{", ".join(_PRECISIONS)}')

    def design_type(self, design: type[NumpyDesign]) -> Callable[[FloatArray, FloatArray], Design]:
        """
        Return a constructor of designs of type `design` whose products use these arrays.

        :raises OptionError: if the namespace cannot be loaded.
        """
        if self == Arrays():
            return design
        device = _Device(self)
        return lambda q, weights: DeviceDesign(design(q, weights), device)


class _Device:
    """A namespace with its device and precision, and transfers of arrays."""

    def __init__(self, arrays: Arrays) -> None:
        self.dtype = arrays.dtype
        try:
            self.xp: Any = import_module(arrays.namespace)
        except ImportError as error:
            raise OptionError(f'arrays: the namespace {arrays.namespace} does not load here '
                              f'({error})') from None
        self._kind = getattr(self.xp, arrays.dtype)
        self._device = {} if arrays.device is None else {'device': arrays.device}

    def to_device(self, values: FloatArray) -> Any:
        """Return a NumPy array as one of the namespace."""
        return self.xp.asarray(np.ascontiguousarray(values), dtype=self._kind, **self._device)

    def to_numpy(self, values: Any) -> FloatArray:
        """Return an array of the namespace as one of NumPy, in float64."""
        for name in ('cpu', 'get'):       # PyTorch's and CuPy's copies from a GPU
            if hasattr(values, name):
                values = getattr(values, name)()
        return np.asarray(np.from_dlpack(values), dtype=np.float64)


class DeviceDesign:
    """
    A design whose products with all columns are computed on the device, all else in NumPy.

    :param design: the design in NumPy.
    """

    def __init__(self, design: NumpyDesign, device: _Device,
                 halves: tuple[Any, Any] | None = None) -> None:
        self.n_rows, self.n_columns = design.n_rows, design.n_columns
        self._design, self._device = design, device
        self._halves = halves or (device.to_device(design.halves.left),
                                  device.to_device(design.halves.right.T))

    @property
    def precise(self) -> Design:
        return self if self._device.dtype == 'float64' else self._design

    def reweighted(self, row_weights: FloatArray) -> DeviceDesign:
        return DeviceDesign(self._design.reweighted(row_weights), self._device, self._halves)

    def columns(self, indices: IntArray) -> FloatArray:
        return self._design.columns(indices)

    def squared_norms(self) -> FloatArray:
        return self._design.squared_norms()

    def correlate(self, r: FloatArray) -> FloatArray:
        return self.correlate_many(r[:, None])[0]

    def correlate_many(self, r: FloatArray) -> FloatArray:
        if not r.shape[1]:
            return np.zeros((0, self.n_columns))
        return np.stack([self._device.to_numpy(self._correlate(one)) for one in r.T])

    def _correlate(self, r: FloatArray) -> Any:
        """Return A.T r over all columns: one batched product for all torques."""
        xp, (left, right) = self._device.xp, self._halves
        weighted = self._device.to_device(self._design.weighted_rows(r))
        parts = xp.matmul(left, weighted[:, :, None] * right[None, :, :])
        if isinstance(self._design, TorqueDesign):
            return xp.reshape(parts, (-1,))
        total = xp.zeros_like(xp.reshape(parts[0, ...], (-1,)))
        for n in range(self._design.n_joints):
            features = xp.reshape(parts[n, ...], (3 ** n, 3, -1))
            sine, cosine = features[:, dictionary.SIN, :], features[:, dictionary.COS, :]
            # d sin = cos, d cos = -sin: products with cos belong to sin, and vice versa.
            swapped = self._concat([part[:, None, :] for part in (
                xp.zeros_like(sine), cosine, -sine)])
            total = total + xp.reshape(swapped, (-1,))
        return total

    def _concat(self, parts: list[Any]) -> Any:
        xp = self._device.xp
        if hasattr(xp, 'concat') and xp.__name__ != 'torch':
            return xp.concat(parts, axis=1)
        return xp.concatenate(parts, 1)   # PyTorch, and NumPy before 2.0
