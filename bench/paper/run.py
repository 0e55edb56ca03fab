"""
Reproduction of the tables of Yu 2022, with other methods.

Run from the root of the repository, in a Python with requirements/bench.txt:

    OPENBLAS_NUM_THREADS=1 python -m bench.paper.run --seeds 3 [--tables table_3 friction]

writes the tables between marks in docs/paper.md. Figures are the worst of all seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import re

from bench.paper import page
from bench.paper.baselines import explicit, kernel_ridge, nominal, regression
from bench.paper.methods import formulation, Method, Row, score, stale, updated, worst
from bench.paper.scenes import friction_test, PAYLOADS, real, Scene, simulated, small_motion

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'paper.md'
_FORMULATIONS = {name: formulation(name) for name in ('per_joint', 'potential', 'chain')}
_KNOWN_KINEMATICS = {'linear regression, known kinematics': regression,
                     'EFD, wrong parameters': explicit, 'Pinocchio, nominal URDF': nominal}
_ALL: dict[str, Method] = {**_FORMULATIONS, 'kernel ridge': kernel_ridge, **_KNOWN_KINEMATICS}
_PAYLOAD_METHODS: dict[str, Method] = {
    'stale chain, without payload': stale, 'per_joint, refitted': _FORMULATIONS['per_joint'],
    'potential, refitted': _FORMULATIONS['potential'],
    'chain with friction, refitted': formulation('chain', friction=True),
    'chain, updated from 10 s': updated(urdf=False),
    'chain, updated from 10 s with a URDF': updated(urdf=True),
    'linear regression, known kinematics': regression}
TABLES: dict[str, Callable[[int], str]] = {
    'table_3': lambda seeds: page.table_3(rows(_ALL, seeds, simulated)),
    'small_motion': lambda seeds: page.small_motion(rows(_FORMULATIONS, seeds, small_motion)),
    'friction': lambda seeds: page.friction(
        {f'J{joint + 1}': friction_test(joint) for joint in (1, 3)}),
    'table_4': lambda seeds: page.table_4(rows(_ALL, seeds, real)),
    'table_5': lambda seeds: page.table_5({
        payload: rows(_PAYLOAD_METHODS, seeds, lambda seed, name=payload: real(seed, name))
        for payload in PAYLOADS})}


def main() -> int:
    """Make the tables and write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seeds', type=int, default=10)
    parser.add_argument('--tables', nargs='+', choices=list(TABLES), default=list(TABLES))
    args = parser.parse_args()
    for name in args.tables:
        text = TABLES[name](args.seeds)
        PAGE.write_text(with_table(PAGE.read_text(encoding='utf-8'), name, text),
                        encoding='utf-8')
        print(text, flush=True)
    return 0


def with_table(text: str, name: str, table: str) -> str:
    """Return a page with a table between its marks."""
    marks = re.compile(f'(<!-- {name} -->\n).*?(<!-- end -->)', re.DOTALL)
    return marks.sub(lambda found: f'{found[1]}{table}\n{found[2]}', text)


def rows(methods: dict[str, Method], seeds: int, scene_of: Callable[[int], Scene]) -> list[Row]:
    """Return the worst results of every method over all seeds."""
    out = []
    for name, method in methods.items():
        # Kernel methods take minutes, and their errors hardly change with the seed.
        count = 1 if name == 'kernel ridge' else seeds
        out.append(worst([score(name, method, scene_of(seed)) for seed in range(count)]))
        print(f'{name}: {out[-1].seconds:.2f} s', flush=True)
    return out


if __name__ == '__main__':
    raise SystemExit(main())
