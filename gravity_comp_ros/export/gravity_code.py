"""
C statements of a model's gravity torque, and the numbers that they read.

A chain is evaluated by its recursion (`models.kinematic.chain`): the vertical from the base
outwards, the first moments from the tip inwards, 2N rotations in all. The other formulations are
written out term by term, with the products that a term has and no others.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
import zlib

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np


@dataclass
class Numbers:
    """
    Numbers in the order in which the code uses them, with a label and its unit for each.

    They are one array, which a controller can replace (`gc_set_parameters`). `positive` are the
    indices of those that the code divides by, `rotations` that of the first of N rotations.
    """

    labels: list[str] = field(default_factory=list)
    positive: list[int] = field(default_factory=list)
    rotations: int | None = None
    _values: list[float] = field(default_factory=list)

    @property
    def values(self) -> FloatArray:
        """Return the numbers (K,)."""
        return np.array(self._values)

    @property
    def layout(self) -> int:
        """Return the CRC-32 of the labels: numbers of the same layout have the same meaning."""
        return zlib.crc32('\n'.join(self.labels).encode())

    def add(self, label: str, value: float, positive: bool = False) -> str:
        """Add a number and return the C expression that reads it."""
        if positive:
            self.positive.append(len(self.labels))
        self.labels.append(label)
        self._values.append(float(value))
        return f'gc_p[{len(self.labels) - 1}]'

    def add_all(self, labels: Iterable[str], values: Iterable[float]) -> int:
        """Add numbers and return the index of the first."""
        start = len(self.labels)
        for label, value in zip(labels, values):
            self.add(label, value)
        return start


_CHAIN = """\
    const gc_real *h = gc_p + @H@;
    const gc_real *a = gc_p + @A@;
    gc_real w[GC_N][3];
    gc_real up0 = GC_C(0.0), up1 = GC_C(0.0), up2 = GC_C(1.0);
    gc_real m0 = GC_C(0.0), m1 = GC_C(0.0), m2 = GC_C(0.0);
    int i;
    /* The vertical in the frame of each link, from the base outwards. */
    for (i = 0; i < GC_N; ++i) {
        const gc_real *r = a + 9 * i;
        const gc_real x = r[0] * up0 + r[3] * up1 + r[6] * up2;
        const gc_real y = r[1] * up0 + r[4] * up1 + r[7] * up2;
        const gc_real z = r[2] * up0 + r[5] * up1 + r[8] * up2;
        up0 = w[i][0] = c[i] * x + s[i] * y;
        up1 = w[i][1] = c[i] * y - s[i] * x;
        up2 = w[i][2] = z;
    }
    /* The first moment of each link and all links beyond it, from the tip inwards. */
    for (i = GC_N - 1; i >= 0; --i) {
        const gc_real *r = a + 9 * i;
        gc_real x, y;
        m0 += h[2 * i];
        m1 += h[2 * i + 1];
        tau[i] = w[i][1] * m0 - w[i][0] * m1;
        x = c[i] * m0 - s[i] * m1;
        y = s[i] * m0 + c[i] * m1;
        m0 = r[0] * x + r[1] * y + r[2] * m2;
        m1 = r[3] * x + r[4] * y + r[5] * m2;
        m2 = r[6] * x + r[7] * y + r[8] * m2;
    }"""


def gravity_code(model: GravityModel, numbers: Numbers) -> str:
    """
    Return statements that add gravity to `tau`, 0 before, from sines `s` and cosines `c`.

    Order of the numbers: of a chain, first the moments h_x, h_y of every joint, then the rotations
    A of every joint by rows; of an energy, its weights by ascending feature; else the weights of
    each joint by ascending feature.
    """
    if model.chain is not None:
        return _chain(model, model.chain, numbers)
    return '\n'.join(_energy(model, model.energy, numbers) if model.energy is not None
                     else _torques(model.joints, model.torques, numbers))


def _chain(model: GravityModel, chain: Chain, numbers: Numbers) -> str:
    moments = numbers.add_all((f'{joint} h_{axis} N*m' for joint in model.joints
                               for axis in 'xy'), chain.moments.ravel())
    axes = numbers.add_all((f'{joint} A_{row}{column}' for joint in model.joints
                            for row in '123' for column in '123'), chain.axes.ravel())
    numbers.rotations = axes
    return _CHAIN.replace('@H@', str(moments)).replace('@A@', str(axes))


def _energy(model: GravityModel, energy: Expansion, numbers: Numbers) -> list[str]:
    """Return tau_n += w d(phi)/d(q_n) for every term phi and joint n of the energy."""
    n, lines = model.n_joints, []
    names = dictionary.feature_names(energy.indices, n)
    for name, weight, factors in zip(names, energy.weights, dictionary.digits(energy.indices, n)):
        number = numbers.add(f'energy {name} J', float(weight))
        for joint in range(n):
            if factors[joint] != dictionary.ONE:
                sign = '+' if factors[joint] == dictionary.SIN else '-'
                swapped = factors.copy()
                swapped[joint] = dictionary.SIN + dictionary.COS - factors[joint]
                lines.append(f'    tau[{joint}] {sign}= {_product(number, swapped.tolist())};')
    return lines


def _torques(joints: Sequence[str], torques: Sequence[Expansion],
             numbers: Numbers) -> list[str]:
    """Return statements that add one sum over the dictionary to the torque of each joint."""
    lines = []
    for joint, torque in enumerate(torques):
        names = dictionary.feature_names(torque.indices, len(joints))
        factors = dictionary.digits(torque.indices, len(joints)).tolist()
        for name, weight, factor in zip(names, torque.weights.tolist(), factors):
            number = numbers.add(f'{joints[joint]} {name} N*m', weight)
            lines.append(f'    tau[{joint}] += {_product(number, factor)};')
    return lines


def _product(number: str, factors: list[int]) -> str:
    return ' * '.join([number, *(f'{" sc"[factor]}[{joint}]' for joint, factor in
                                 enumerate(factors) if factor != dictionary.ONE)])
