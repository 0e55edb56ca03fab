"""
Reproduction of the tables and figures of Yu 2022, with other methods and real recordings.

Run from the root of the repository, in a Python with requirements/bench.txt:

    OPENBLAS_NUM_THREADS=1 python -m bench.paper.run --seeds 10 --data FOLDER

writes docs/paper.md and docs/paper/*.svg. FOLDER contains the public recordings listed in
bench/paper/recordings.py; without it that table is omitted. --tiny runs everything small.
"""

from __future__ import annotations

import argparse
from importlib.util import find_spec
import os
from pathlib import Path
import platform

from bench.paper import figures, page
from bench.paper.baselines import explicit, kernel_ridge, nominal, regression
from bench.paper.friction import check
from bench.paper.methods import formulation, Method, stale, updated
from bench.paper.recordings import BAGS, evaluate
from bench.paper.scenes import PAYLOADS, real, Scene, simulated, Sizes, TINY
from bench.paper.score import Row, score, worst
from bench.paper.text import TEXT
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
# Kernel methods take minutes, and their errors hardly change with the seed.
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
    payloads = list(PAYLOADS)[:1] if args.tiny else list(PAYLOADS)
    parts['table_5'] = page.table_5({payload: _rows(
        _payload_methods(args.tiny), seeds,
        lambda seed, name=payload: real(seed, name, sizes)) for payload in payloads})
    parts['friction'] = page.friction_table([check(1), check(3)])
    parts['recordings'] = _recordings(args.data, args.tiny)
    _figures(folder, sizes, payloads)
    out.write_text(TEXT.format(**parts, folder=folder.name), encoding='utf-8')
    print(f'wrote {out} and {folder}/*.svg')
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    out = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    out.add_argument('--seeds', type=int, default=10)
    out.add_argument('--data', type=Path, help='folder of public recordings')
    out.add_argument('--tiny', action='store_true', help='small sizes, for a test')
    out.add_argument('-o', '--output', default=str(ROOT / 'docs' / 'paper.md'))
    return out


def _has(module: str) -> bool:
    return find_spec(module) is not None


def _kernels(quick: bool) -> dict[str, Method]:
    if not _has('sklearn'):
        print('scikit-learn is not installed: no kernel ridge')
        return {}
    return {'kernel ridge': kernel_ridge(quick)}


def _known_kinematics() -> dict[str, Method]:
    return {'linear regression, known kinematics': regression,
            'EFD, wrong parameters': explicit, 'Pinocchio, nominal URDF': nominal}


def _simulated_methods(quick: bool) -> dict[str, Method]:
    return {'per_joint': formulation('per_joint'), 'potential': formulation('potential'),
            'chain': formulation('chain'), **_kernels(quick), **_known_kinematics()}


def _real_methods(quick: bool) -> dict[str, Method]:
    if quick:
        return {'chain with friction': formulation('chain', friction=True), **_known_kinematics()}
    return {'per_joint': formulation('per_joint'), 'potential': formulation('potential'),
            'chain': formulation('chain'), **_kernels(quick), **_known_kinematics()}


def _payload_methods(quick: bool) -> dict[str, Method]:
    learned = {'chain, updated from 10 s': updated(urdf=False),
               'chain, updated from 10 s with a URDF': updated(urdf=True),
               'linear regression, known kinematics': regression}
    if quick:
        return learned
    return {'stale chain, without payload': stale, 'per_joint, refitted': formulation('per_joint'),
            'potential, refitted': formulation('potential'),
            'chain with friction, refitted': formulation('chain', friction=True),
            **learned}


def _rows(methods: dict[str, Method], seeds: int, scene_of) -> list[Row]:
    """Return the worst results of every method over all seeds."""
    scenes: dict[int, Scene] = {}
    rows = []
    for name, method in methods.items():
        count = min(seeds, _KERNEL_SEEDS) if 'kernel' in name else seeds
        results = []
        for seed in range(count):
            if seed not in scenes:
                scenes[seed] = scene_of(seed)
            results.append(score(name, method, scenes[seed]))
        rows.append(worst(results))
        print(f'{scenes[0].title}: {name}: {rows[-1].seconds:.2f} s, trained range '
              f'{rows[-1].inside.max():.3f} N·m, whole range {rows[-1].anywhere.max():.3f} N·m',
              flush=True)
    return rows


def _recordings(data: Path | None, quick: bool) -> str:
    if data is None:
        return '(not run: no folder of recordings was given)'
    rows = []
    for path, name in BAGS:
        if (data / path).exists():
            rows += evaluate(data / path, name, *((('potential',),) if quick else ()))
            print(f'{name}: done', flush=True)
        else:
            print(f'{data / path} is missing')
    return page.recordings_table(rows)


def _figures(folder: Path, sizes: Sizes, payloads: list[str]) -> None:
    scene = simulated(0, sizes)
    fitted = {'per_joint': formulation('per_joint')(scene), 'chain': formulation('chain')(scene)}
    _write(folder, 'fig4', figures.torques(scene, fitted, (1, 2, 3), 10.0))
    _write(folder, 'fig8', figures.sweeps([check(1), check(3)]))
    scene = real(0, None, sizes)
    fitted = {'per_joint': formulation('per_joint')(scene),
              'chain': formulation('chain', friction=True)(scene)}
    _write(folder, 'fig9', figures.torques(scene, fitted, (0, 1, 2, 3), 5.0))
    for number, payload in zip((11, 12, 13), payloads):
        scene = real(0, payload, sizes)
        fitted = {'stale': stale(scene), 'updated from 10 s': updated(False)(scene)}
        _write(folder, f'fig{number}', figures.torques(scene, fitted, (1, 3, 5), 5.0))


def _write(folder: Path, name: str, text: str) -> None:
    (folder / f'{name}.svg').write_text(text, encoding='utf-8')


if __name__ == '__main__':
    raise SystemExit(main())
