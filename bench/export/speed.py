"""
Time of a call of an exported model of the iiwa, in every formulation.

    python3 -m bench.export.speed

needs gcc. The printed time is the mean of 201 rounds over the same 2000 poses.
"""

from __future__ import annotations

from pathlib import Path
import subprocess
import tempfile

from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.export.c_source import c_source
from gravity_comp_ros.recordings.bag import read_bag

BAG = Path(__file__).resolve().parents[2] / 'bags' / 'eq17_unloaded.mcap'
PROGRAM = r"""
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "gc_gravity.h"

enum { POSES = 2000, ROUNDS = 201 };

int main(void) {
  static double q[POSES][GC_N];
  double tau[GC_N], sum = 0.0;
  for (int k = 0; k < POSES; ++k)
    for (int n = 0; n < GC_N; ++n) q[k][n] = 6.0 * rand() / RAND_MAX - 3.0;
  const clock_t start = clock();
  for (int round = 0; round < ROUNDS; ++round)
    for (int k = 0; k < POSES; ++k) { gc_gravity(q[k], tau); sum += tau[1]; }
  printf("%.0f ns\n", 1e9 * (clock() - start) / CLOCKS_PER_SEC / POSES / ROUNDS);
  return sum == 0.12345;
}
"""


def main() -> None:
    """Compile the source of each model, and print the time of a call."""
    samples = slow_samples(read_bag(BAG).samples).samples
    for kind in ('chain', 'potential', 'per_joint'):
        code = c_source(fit(samples, FitOptions(formulation=kind)).model)
        with tempfile.TemporaryDirectory() as folder:
            for name, text in (('speed.c', PROGRAM), (code.header_name, code.header),
                               (code.source_name, code.source)):
                (Path(folder) / name).write_text(text)
            subprocess.run(['gcc', '-std=gnu99', '-O2', 'speed.c', code.source_name, '-o', 'speed',
                            '-lm'], cwd=folder, check=True)
            print(kind, subprocess.check_output([f'{folder}/speed'], text=True), end='')


if __name__ == '__main__':
    main()
