"""
Compare the package's table reader with pandas, each in its own process.

    python3 -m bench.scale.csv_readers [--rows 65000] [--python PYTHON_WITH_PANDAS]

A table of 21 columns is written to a temporary folder. The output is the processor time of the
import and of reading, and the peak memory of the process.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import subprocess
import sys
import tempfile

_OWN = 'from gravity_comp_ros.recordings.table_files import read_csv; from pathlib import Path'
_OWN_READ = 'values = read_csv(Path(sys.argv[1])).values'
_PANDAS, _PANDAS_READ = 'import pandas', 'values = pandas.read_csv(sys.argv[1]).to_numpy()'
_TIMED = """
import resource, sys, time
start = time.process_time()
{load}
ready = time.process_time()
{read}
done = time.process_time()
print(f'{{values.shape[0]}} rows: import {{ready - start:.2f}} s, read {{done - ready:.2f}} s, '
      f'{{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024}} MB')
"""


def main() -> int:
    """Write a table and time both readers."""
    import numpy as np
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rows', type=int, default=65000)
    parser.add_argument('--python', default=sys.executable, help='a Python with pandas')
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'table.csv'
        values = np.random.default_rng(0).normal(size=(args.rows, 21))
        np.savetxt(path, values, '%.15f', ',', comments='',
                   header=','.join(f'c{k}' for k in range(21)))
        for name, python, load, read in (('own', sys.executable, _OWN, _OWN_READ),
                                         ('pandas', args.python, _PANDAS, _PANDAS_READ)):
            script = _TIMED.format(load=load, read=read)
            child = subprocess.run([python, '-c', script, str(path)], text=True,
                                   capture_output=True, timeout=300, check=False)
            print(f'{name}: {child.stdout.strip() or child.stderr.splitlines()[-1]}')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
