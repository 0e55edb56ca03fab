"""
Maximum-likelihood fit of the power of a diagnosis as a function of the separation.

    python -m bench.planning.calibrate small.jsonl [more.jsonl ...]

The power is Phi(ln(s / s_half) / width), with s the separation at the true size. The input are
results of `bench.planning.run --small` on the tuning arms.
"""

from __future__ import annotations

import json
from pathlib import Path
import sys

from bench.planning.table import expectations
from gravity_comp_ros.diagnosis.findings import FOUND
import numpy as np
from scipy import optimize, special


def main() -> int:
    """Print the parameters."""
    results = [json.loads(line) for name in sys.argv[1:]
               for line in Path(name).read_text().splitlines()]
    pairs = [(e['share'] * e['separation'], e['outcome'] in FOUND) for e in expectations(results)
             if 'share' in e and not e['untestable']]
    log = np.log(np.maximum([s for s, _ in pairs], 1e-3))
    is_found = np.array([f for _, f in pairs])

    def cost(x: np.ndarray) -> float:
        z = (log - x[0]) / np.exp(x[1])
        # Weak prior: s_half = 8 and width = 0.7, both within a factor of e.
        prior = 0.5 * ((x[0] - np.log(8.0)) ** 2 + (x[1] - np.log(0.7)) ** 2)
        return float(prior - special.log_ndtr(np.where(is_found, z, -z)).sum())

    best = optimize.minimize(cost, np.log([8.0, 0.7]), method='Nelder-Mead').x
    print(f'{len(pairs)} motions, {int(is_found.sum())} found: s_half {np.exp(best[0]):.2f}, '
          f'width {np.exp(best[1]):.2f}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
