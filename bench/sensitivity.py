"""
Sensitivity of the loop to every number that the package assigns.

Run from the root of the repository:

    python -m bench.sensitivity results/ --rooms regression,effects --jobs 2
    python -m bench.sensitivity results/ --only 'Options.margin|_SPREAD' --joints 7 --seconds 90

Numbers are module constants and defaults of options classes, alone or in tuples. Each is doubled
and halved (a share above 0.9 has its complement doubled and halved; of a whole number, at least
1). Then `fit`, `diagnose` and `add` run on tuning cases of `bench.real_robots`, every other one
with its description. To save time these are the first part of the training runs of arms with their
first joints only. The output has, for the worst case,

- the findings that differ from those of the unchanged package (effect, joint, verdict);
- the change of the torque on the unseen run, worst joint, rms, in noise levels;
- whether a case that was right is wrong, or an error was raised.

A number without any change is not tuned: it limits memory or effort, or the cases do not reach it.
A number that another one was computed from at import keeps its effect there.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
import gc as collector
import importlib
import json
from multiprocessing import get_context
import os
from pathlib import Path
import pkgutil
import re
import sys
from types import ModuleType
from typing import Any

from bench.real_robots.arms import SOURCES
from bench.real_robots.cases import Case, case, Run
from bench.real_robots.product import loop
from bench.real_robots.score import score
import gravity_comp_ros
from gravity_comp_ros.atomic import write_atomically
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import GravityCompError
import numpy as np

ROOMS = ('regression', 'effects', 'diagnosis', 'estimation', 'models', 'data')
FACTORS = (2.0, 0.5)


@dataclass(frozen=True)
class Number:
    """An assigned number: module, its class (empty for a constant) and name, and its value."""

    module: str
    owner: str
    name: str
    value: Any

    def __str__(self) -> str:
        where = self.module.removeprefix('gravity_comp_ros.')
        return f'{where}:{self.owner + "." if self.owner else ""}{self.name}'


@dataclass(frozen=True)
class Outcome:
    """Outcome of one case: findings, torque on the unseen run (M, N) in noise levels, faults."""

    findings: frozenset[str]
    torque: FloatArray
    why: tuple[str, ...]


Cases = list[tuple[Case, bool]]
_CASES: Cases = []
"""Cases, and whether the fit has the description; forked processes read them."""


def main() -> int:
    """Vary each number, and print what changes."""
    parser = argparse.ArgumentParser(description='Sensitivity to the numbers of the package.')
    parser.add_argument('folder', help='folder of results')
    parser.add_argument('--rooms', default=','.join(ROOMS))
    parser.add_argument('--only', default='', help='regular expression of names of numbers')
    parser.add_argument('--cases', default='panda.401,kinova.400,xarm7.401,talos.400',
                        help='ARM.SEED of bench.real_robots, tuning seeds (default: %(default)s)')
    parser.add_argument('--joints', type=int, default=3, help='(default: %(default)s)')
    parser.add_argument('--seconds', type=float, default=40.0, help='(default: %(default)s)')
    parser.add_argument('--jobs', type=int, default=1, help='processes (default: %(default)s)')
    args = parser.parse_args()
    folder = Path(args.folder)
    folder.mkdir(parents=True, exist_ok=True)
    for index, name in enumerate(args.cases.split(',')):
        arm, seed = name.split('.')
        _CASES.append((part(arm, int(seed), args.joints, args.seconds), bool(index % 2)))
    tasks = [(number, factor) for room in args.rooms.split(',') for number in numbers(room)
             if re.search(args.only, str(number)) for factor in FACTORS]
    unchanged = outcomes()
    results = {}
    with get_context('fork').Pool(args.jobs, maxtasksperchild=1) as pool:
        for (number, factor), result in zip(tasks, pool.imap(varied, tasks)):
            line = result if isinstance(result, str) else changes(unchanged, result)
            results[f'{number} x {factor}'] = line
            print(f'{number} = {number.value} x {factor}: {line}', flush=True)
            write_atomically(folder / 'sensitivity.json',
                             json.dumps(results, indent=1).encode(), GravityCompError)
    return 0


def part(arm: str, seed: int, joints: int, seconds: float) -> Case:
    """Return a case of an arm with its first joints, and the first part of its training runs."""
    name, source = f'{arm}-{joints}', SOURCES[arm]
    SOURCES[name] = replace(source, joints=source.joints[:joints])
    whole = case(name, seed)
    return replace(whole, train=tuple(Run(*(x[run.t < run.t[0] + seconds] for x in (
        run.t, run.q, run.qd, run.tau))) for run in whole.train))


def numbers(room: str) -> Iterator[Number]:
    """Yield the numbers assigned in a room, those of its modules in alphabetical order."""
    package = importlib.import_module(f'gravity_comp_ros.{room}')
    for each in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
        module = importlib.import_module(each.name)
        for name in _assigned(module):
            value = getattr(module, name)
            if _is_number(value):
                yield Number(module.__name__, '', name, value)
            elif isinstance(value, type) and is_dataclass(value):
                yield from (Number(module.__name__, name, field.name, field.default)
                            for field in fields(value) if _is_number(field.default))


def _assigned(module: ModuleType) -> list[str]:
    """Return the names that a module assigns or defines itself."""
    assert module.__file__ is not None
    out = []
    for node in ast.parse(Path(module.__file__).read_text(encoding='utf-8')).body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            out += [target.id] if isinstance(target, ast.Name) else []
        elif isinstance(node, ast.ClassDef):
            out.append(node.name)
    return [name for name in out if hasattr(module, name)]


def _is_number(value: object) -> bool:
    if isinstance(value, tuple):
        return bool(value) and all(_is_number(part) for part in value)
    return isinstance(value, (int, float)) and not isinstance(value, bool) and value != 0


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or the numbers of a tuple, times a factor."""
    if isinstance(value, tuple):
        return tuple(scaled(part, factor) for part in value)
    if isinstance(value, int):
        return max(round(value * factor), 1)
    return 1.0 - factor * (1.0 - value) if 0.9 < value < 1.0 else value * factor


def assign(number: Number, value: Any) -> None:
    """Assign a value in every module that has the number, and in every instance of its class."""
    if not number.owner:
        for module in _modules():
            if vars(module).get(number.name) is number.value:
                setattr(module, number.name, value)
        return
    owner = getattr(importlib.import_module(number.module), number.owner)
    owner.__init__.__defaults__ = _with_default(owner, number.name, value)
    for instance in collector.get_objects():
        if type(instance) is owner and getattr(instance, number.name) == number.value:
            object.__setattr__(instance, number.name, value)


def _with_default(owner: type, name: str, value: Any) -> tuple[Any, ...]:
    """Return the defaults of the constructor with another one for a field."""
    init: Any = owner.__init__
    names = init.__code__.co_varnames[:init.__code__.co_argcount][-len(init.__defaults__):]
    return tuple(value if field == name else default
                 for field, default in zip(names, init.__defaults__))


def _modules() -> list[ModuleType]:
    return [module for name, module in sorted(sys.modules.items())
            if name.startswith(gravity_comp_ros.__name__)]


def varied(task: tuple[Number, float]) -> list[Outcome] | str:
    """Return the outcomes with one number changed, in a process of its own, or the error."""
    number, factor = task
    assign(number, scaled(number.value, factor))
    try:
        return outcomes()
    except Exception as problem:  # A changed number may break anything.
        return f'{type(problem).__name__}: {problem}'


def outcomes() -> list[Outcome]:
    """Return the outcome of the loop on each case."""
    out = []
    for one, described in _CASES:
        result = loop(one, described)
        judged = score(one, result.findings, result.torque, result.static)
        findings = frozenset(f'{f["effect"]}:{f["joint"]} {f["verdict"]}'
                             for f in result.findings)
        out.append(Outcome(findings, result.torque / one.noise, judged.why))
    return out


def changes(unchanged: list[Outcome], new: list[Outcome]) -> dict[str, Any]:
    """Return the differences: findings, torque in noise levels, and cases that are wrong now."""
    rms = [float(np.sqrt(((a.torque - b.torque) ** 2).mean(axis=0)).max())
           for a, b in zip(unchanged, new)]
    return {'findings': sorted(name for a, b in zip(unchanged, new)
                               for name in a.findings ^ b.findings),
            'torque': round(max(rms), 4),
            'wrong': sorted({reason for a, b in zip(unchanged, new) if not a.why
                             for reason in b.why})}


if __name__ == '__main__':
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    sys.exit(main())
