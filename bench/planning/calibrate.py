"""
Fit the chance that an effect is found to its separation, by maximum likelihood.

    python -m bench.planning.calibrate small.jsonl [more.jsonl ...]

The chance is Phi(ln(s / s_half) / width), s the separation at the true size. Give it the results
of `bench.planning.run --small` on the arms that are tuned on.
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
    seen = [(e['share'] * e['separation'], e['outcome'] in FOUND) for e in expectations(results)
            if 'share' in e and not e['untestable']]
    log, found = np.log(np.maximum([s for s, _ in seen], 1e-3)), np.array([f for _, f in seen])

    def cost(x: np.ndarray) -> float:
        z = (log - x[0]) / np.exp(x[1])
        # A weak prior: s_half of 8 within a factor of e, a width of 0.7 within the same.
        prior = 0.5 * ((x[0] - np.log(8.0)) ** 2 + (x[1] - np.log(0.7)) ** 2)
        return float(prior - special.log_ndtr(np.where(found, z, -z)).sum())

    best = optimize.minimize(cost, np.log([8.0, 0.7]), method='Nelder-Mead').x
    print(f'{len(seen)} motions, {int(found.sum())} found: s_half {np.exp(best[0]):.2f}, '
          f'width {np.exp(best[1]):.2f}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
