"""A model's exported C source as a shared library, called through ctypes."""

import ctypes
from pathlib import Path
import shutil
import subprocess

from gravity_comp_ros.export.c_source import c_source
import numpy as np
import pytest

STRICT = ('-Wall', '-Wextra', '-Werror', '-pedantic', '-Wconversion', '-Wshadow',
          '-fPIC', '-shared')
COMPILERS = {'c99': ('gcc', '-std=c99', '-O2'), 'unoptimised': ('gcc', '-std=c99', '-O0'),
             'c++17': ('g++', '-x', 'c++', '-std=c++17', '-O2'),
             'float': ('gcc', '-std=c99', '-O2', '-DGC_REAL=float', '-Wdouble-promotion')}


class Library:
    """The functions of an exported model on arrays of poses."""

    def __init__(self, path: Path, n_joints: int, real=np.float64):
        self.library = ctypes.CDLL(str(path))
        self.library.gc_distance.restype = ctypes.c_float if real == np.float32 \
            else ctypes.c_double
        self.n, self.real = n_joints, real

    def gravity(self, q):
        return self._over('gc_gravity', q)

    def static(self, q):
        return self._over('gc_static', q)

    def friction(self, q, qd):
        return self._over('gc_friction', q, qd)

    def distance(self, q):
        q = np.ascontiguousarray(q, dtype=self.real)
        return np.array([self.library.gc_distance(row.ctypes.data_as(ctypes.c_void_p))
                         for row in q])

    def set_parameters(self, values, layout):
        values = np.ascontiguousarray(values, dtype=np.float64)
        return self.library.gc_set_parameters(values.ctypes.data_as(ctypes.c_void_p),
                                              len(values), ctypes.c_uint(layout))

    def _over(self, name, *inputs):
        inputs = [np.ascontiguousarray(x, dtype=self.real) for x in inputs]
        tau, call = np.full_like(inputs[0], np.nan), getattr(self.library, name)
        for row, *rows in zip(tau, *inputs):
            call(*(x.ctypes.data_as(ctypes.c_void_p) for x in (*rows, row)))
        return tau


def compiled(model, folder: Path, kind: str = 'c99') -> Library:
    """Return the library of a model, compiled without a warning."""
    command = COMPILERS[kind]
    if shutil.which(command[0]) is None:
        pytest.skip(f'no {command[0]}')
    code = c_source(model)
    (folder / code.header_name).write_text(code.header)
    (folder / code.source_name).write_text(code.source)
    output = folder / f'{kind}.so'
    done = subprocess.run([*command, *STRICT, code.source_name, '-o', str(output), '-lm'],
                          cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return Library(output, model.n_joints, np.float32 if kind == 'float' else np.float64)
