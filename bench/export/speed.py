"""
Time of a call of an exported model of the iiwa, in every formulation.

    python3 -m bench.export.speed

needs gcc. The formulations alternate over the same 2000 poses in one process; the printed times
are the median and the 99 % quantile of 201 rounds.
"""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import tempfile

from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.export.c_source import c_source
from gravity_comp_ros.recordings.bag import read_bag

BAG = Path(__file__).resolve().parents[2] / 'bags' / 'eq17_unloaded.mcap'
KINDS = ('chain', 'potential', 'per_joint')

PROGRAM = r"""
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "chain_gravity.h"
#include "potential_gravity.h"
#include "per_joint_gravity.h"

enum { N = CHAIN_N, POSES = 2000, ROUNDS = 201, KINDS = 3 };

static double q[POSES][N], times[KINDS][ROUNDS];

static int ascending(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

int main(void) {
  const char *names[KINDS] = {"chain", "potential", "per_joint"};
  void (*calls[KINDS])(const double *, double *) = {
      chain_gravity, potential_gravity, per_joint_gravity};
  double tau[N], sum = 0.0;
  srand(1);
  for (int k = 0; k < POSES; ++k)
    for (int n = 0; n < N; ++n) q[k][n] = 6.0 * rand() / RAND_MAX - 3.0;
  for (int round = 0; round < ROUNDS; ++round)
    for (int i = 0; i < KINDS; ++i) {
      struct timespec start, end;
      clock_gettime(CLOCK_MONOTONIC, &start);
      for (int k = 0; k < POSES; ++k) { calls[i](q[k], tau); sum += tau[1]; }
      clock_gettime(CLOCK_MONOTONIC, &end);
      times[i][round] = (1e9 * (end.tv_sec - start.tv_sec)
                         + (end.tv_nsec - start.tv_nsec)) / POSES;
    }
  for (int i = 0; i < KINDS; ++i) {
    qsort(times[i], ROUNDS, sizeof(double), ascending);
    printf("%-10s %.0f ns, 99 %%: %.0f ns\n", names[i], times[i][ROUNDS / 2],
           times[i][ROUNDS * 99 / 100]);
  }
  return sum == 0.12345;
}
"""


def main() -> int:
    """Compile and run; the program prints the times."""
    samples = slow_samples(read_bag(BAG).samples).samples
    with tempfile.TemporaryDirectory() as name:
        folder, sources = Path(name), ['speed.c']
        (folder / 'speed.c').write_text(PROGRAM)
        for kind in KINDS:
            code = c_source(fit(samples, FitOptions(formulation=kind)).model, kind)
            (folder / code.header_name).write_text(code.header)
            (folder / code.source_name).write_text(code.source)
            sources.append(code.source_name)
        subprocess.run(['gcc', '-std=gnu99', '-O2', *sources, '-o', 'speed', '-lm'], cwd=folder,
                       check=True)
        return subprocess.run([folder / 'speed'], check=False).returncode


if __name__ == '__main__':
    sys.exit(main())
