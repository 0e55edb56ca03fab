"""
Yu 2022, side by side: its tables and figures, with rivals, on simulated arms and recordings.

Run from the root of the repository, in a Python with requirements/bench.txt:

    OPENBLAS_NUM_THREADS=1 python -m bench.paper.run --seeds 10 --data FOLDER

writes docs/paper.md and docs/paper/*.svg. FOLDER holds the public recordings that
bench/paper/recordings.py names; without it that table is left out. --tiny runs everything small.
"""

from __future__ import annotations

import argparse
from importlib.util import find_spec
import os
from pathlib import Path
import platform

from bench.paper import figures, page
from bench.paper.friction import check
from bench.paper.methods import formulation, Method, stale, updated
from bench.paper.recordings import BAGS, judge
from bench.paper.rivals import explicit, kernel, nominal, regression
from bench.paper.scenes import PAYLOADS, real, Scene, simulated, Sizes, TINY
from bench.paper.score import Row, score, worst
from bench.paper.solvers import compare_solvers
from bench.paper.text import TEXT
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
# Kernels take minutes; their figures hardly change with the seed.
_KERNEL_SEEDS = 1


def main(argv: list[str] | None = None) -> int:
    """Run everything and write the page."""
    args = parser().parse_args(argv)
    sizes = TINY if args.tiny else Sizes()
    seeds = 1 if args.tiny else args.seeds
    out = Path(args.output)
    folder = out.with_suffix('')
    folder.mkdir(parents=True, exist_ok=True)
    parts = {'seeds': str(seeds), 'kernel_seeds': str(min(seeds, _KERNEL_SEEDS)),
             'machine': f'Python {platform.python_version()}, NumPy {np.__version__}, one thread '
                        f'of {os.cpu_count()} shared cores'}
    parts['table_3'] = page.table_3(_rows(_simulated_methods(args.tiny), seeds,
                                          lambda seed: simulated(seed, sizes)))
    parts['table_4'] = page.table_4(_rows(_real_methods(args.tiny), seeds,
                                          lambda seed: real(seed, None, sizes)))
    tables = []
    payloads = list(PAYLOADS)[:1] if args.tiny else list(PAYLOADS)
    for payload in payloads:
        rows = _rows(_payload_methods(args.tiny), seeds,
                     lambda seed, name=payload: real(seed, name, sizes))
        tables.append(f'### {payload}\n\n{page.table_5(payload, rows)}')
    parts['table_5'] = '\n\n'.join(tables)
    parts['friction'] = page.friction_table([check(1), check(3)])
    train = real(0, None, sizes).train
    few = train.joints(train.names[:3]) if args.tiny else train
    parts['solvers'] = page.solver_table(compare_solvers(few, 1, 0.5, _has('cvxpy')))
    parts['recordings'] = _recordings(args.data, args.tiny)
    _figures(folder, sizes, payloads)
    out.write_text(TEXT.format(**parts, folder=folder.name), encoding='utf-8')
    print(f'wrote {out} and {folder}/*.svg')
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    made.add_argument('--seeds', type=int, default=10)
    made.add_argument('--data', type=Path, help='folder of public recordings')
    made.add_argument('--tiny', action='store_true', help='small sizes, for a test')
    made.add_argument('-o', '--output', default=str(ROOT / 'docs' / 'paper.md'))
    return made


def _has(module: str) -> bool:
    return find_spec(module) is not None


def _kernels(quick: bool) -> dict[str, Method]:
    if not _has('sklearn'):
        print('scikit-learn is not installed: no kernel ridge, no SVR')
        return {}
    return {f'{title} on {what}': kernel(kind, physical, quick)
            for kind, title in (('krr', 'kernel ridge'), ('svr', 'SVR'))
            for physical, what in ((True, 'physical features'), (False, 'raw angles'))}


def _known() -> dict[str, Method]:
    return {'linear regression, known kinematics': regression,
            'EFD, wrong parameters': explicit, 'Pinocchio, nominal URDF': nominal}


def _simulated_methods(quick: bool) -> dict[str, Method]:
    return {'per_joint': formulation('per_joint'), 'potential': formulation('potential'),
            'chain': formulation('chain'), **_kernels(quick), **_known()}


def _real_methods(quick: bool) -> dict[str, Method]:
    if quick:
        return {'chain, friction an effect': formulation('chain', friction=True), **_known()}
    return {'per_joint': formulation('per_joint'), 'potential': formulation('potential'),
            'chain': formulation('chain'),
            'potential, friction an effect': formulation('potential', friction=True),
            'chain, friction an effect': formulation('chain', friction=True),
            **_kernels(quick), **_known()}


def _payload_methods(quick: bool) -> dict[str, Method]:
    learned = {'chain, updated from 10 s': updated(urdf=False),
               'chain, updated from 10 s with a URDF': updated(urdf=True), **_known()}
    if quick:
        return learned
    return {'chain of before (stale)': stale, 'per_joint, fitted again': formulation('per_joint'),
            'potential, fitted again': formulation('potential'),
            'chain, friction an effect, fitted again': formulation('chain', friction=True),
            **learned}


def _rows(methods: dict[str, Method], seeds: int, scene_of) -> list[Row]:
    """Return the worst of all seeds of every method."""
    scenes: dict[int, Scene] = {}
    rows = []
    for name, method in methods.items():
        count = min(seeds, _KERNEL_SEEDS) if 'kernel' in name or 'SVR' in name else seeds
        found = []
        for seed in range(count):
            if seed not in scenes:
                scenes[seed] = scene_of(seed)
            found.append(score(name, method, scenes[seed]))
        rows.append(worst(found))
        print(f'{scenes[0].title}: {name}: {rows[-1].seconds:.2f} s, inside '
              f'{rows[-1].inside.max():.3f} N·m, anywhere {rows[-1].anywhere.max():.3f} N·m',
              flush=True)
    return rows


def _recordings(data: Path | None, quick: bool) -> str:
    if data is None:
        return '(not run: no folder of recordings was given)'
    rows = []
    for path, name in BAGS:
        if (data / path).exists():
            rows += judge(data / path, name, ('potential',), (False,)) if quick \
                else judge(data / path, name)
            print(f'{name}: done', flush=True)
        else:
            print(f'{data / path} is missing')
    return page.recordings_table(rows)


def _figures(folder: Path, sizes: Sizes, payloads: list[str]) -> None:
    scene = simulated(0, sizes)
    drawn = {'per_joint': formulation('per_joint')(scene), 'chain': formulation('chain')(scene)}
    _write(folder, 'fig4', figures.torques(scene, drawn, (1, 2, 3), 10.0))
    _write(folder, 'fig8', figures.sweeps([check(1), check(3)]))
    scene = real(0, None, sizes)
    drawn = {'per_joint': formulation('per_joint')(scene),
             'chain': formulation('chain', friction=True)(scene)}
    _write(folder, 'fig9', figures.torques(scene, drawn, (0, 1, 2, 3), 5.0))
    for number, payload in zip((11, 12, 13), payloads):
        scene = real(0, payload, sizes)
        drawn = {'before (stale)': stale(scene), 'updated from 10 s': updated(False)(scene)}
        _write(folder, f'fig{number}', figures.torques(scene, drawn, (1, 3, 5), 5.0))


def _write(folder: Path, name: str, text: str) -> None:
    (folder / f'{name}.svg').write_text(text, encoding='utf-8')


if __name__ == '__main__':
    raise SystemExit(main())
