"""Score of a diagnosis: its findings against the truth of a hidden-effect case; table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench.cases.cases import Case
from bench.shared.findings import coverage, false_findings, Finding
from bench.shared.runner import Result, table_of
import numpy as np

# Required held-out error relative to a fit with the true effects.
ERROR = 1.25
_HEAD = ('case', 'effects named', 'untestable reported', 'with a false finding',
         'intervals that cover', f'error within {ERROR} x that of the true effects, worst',
         'time in s: median, worst', 'missed, false')


def score(case: Case, diagnosis: Mapping[str, Any], joints: Sequence[str]) -> Result:
    """
    Return the score of the output of `diagnose --json` on a case.

    `named` has one entry for each truth. `wrong` lists truths that are missed, and findings
    without a true effect. `right` is whether the diagnosis finds all truths, or calls them
    untestable, and has no false finding.

    :param joints: the arm's joint names in order.
    """
    findings = [Finding.of(entry, joints) for entry in diagnosis['findings']]
    named = [any(f.names(truth.answers) for f in findings) for truth in case.truths]
    false = false_findings(findings, case.expected | case.allowed)
    missed = [] if case.untestable else [
        f'missed {truth.effect}' for truth, one in zip(case.truths, named) if not one]
    found = not missed if not case.untestable else _called_untestable(
        case, findings, diagnosis, joints)
    known = [truth.known for truth in case.truths if truth.known is not None]
    return {'untestable': case.untestable, 'named': named, 'false': bool(false),
            'wrong': [*missed, *false], 'right': found and not false,
            'covers': [interval.covers for interval in coverage(findings, known)]}


def _called_untestable(case: Case, findings: Sequence[Finding], diagnosis: Mapping[str, Any],
                       joints: Sequence[str]) -> bool:
    """Return whether the truths are reported as ambiguous, or all as untestable."""
    names = {truth.effect for truth in case.truths}
    true_joints = {truth.joint for truth in case.truths}
    related = [f for f in findings if f.joint in true_joints and f.effect in names]
    if any(f.accepted for f in related):
        return False
    for finding in related:
        alternatives = {finding.effect, *(effect for effect, _ in finding.rivals)}
        if finding.verdict in ('untestable', 'ambiguous') and names <= alternatives:
            return True
    reported = [diagnosis['joints'][joints[joint]].get('untestable', {})
                for joint in true_joints if joint is not None]
    untestable = {f.effect for f in related if f.verdict == 'untestable'}
    return any(names <= untestable | set(reasons) for reasons in reported)


def table(results: Sequence[Result]) -> str:
    """Return the counts as Markdown: all recordings first, then each case on each arm."""
    groups = {'all': list(results)}
    for result in results:
        groups.setdefault(f'{result["arm"]} {result["kind"]}', []).append(result)
    return table_of(_HEAD, ((name, *_counts(group)) for name, group in groups.items()))


def _counts(group: Sequence[Result]) -> tuple[str, ...]:
    errors = [error_ratio(result) for result in group if 'floor' in result]
    seconds = [result['seconds'] for result in group]
    return (_share([all(r['named']) for r in group if not r['untestable']]),
            _share([r['right'] for r in group if r['untestable']]),
            _share([r['false'] for r in group]),
            _share([covers for r in group for covers in r['covers']]),
            _share([error <= ERROR for error in errors]) + f', {max(errors, default=np.nan):.2f}',
            f'{np.median(seconds):.0f}, {max(seconds):.0f}',
            '; '.join(f'seed {r["seed"]}: {text}' for r in group for text in r['wrong']))


def error_ratio(result: Result) -> float:
    """Return the worst joint's held-out error relative to a fit with the true effects."""
    after = result['diagnosis']['joints']
    return max(after[name]['rmse_after'] / floor for name, floor in result['floor'].items())


def _share(values: Sequence[bool]) -> str:
    return f'{sum(values)} of {len(values)}'
