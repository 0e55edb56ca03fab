"""Text of a diagnosis: a summary sentence, names of findings, numbers with units."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import TYPE_CHECKING

from gravity_comp_ros.display import percent
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.models.applied_effects import AppliedEffect, Quantity

if TYPE_CHECKING:
    from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding

_MAX_COEFFICIENTS = 2


def verdict(diagnosis: Diagnosis) -> str:
    """Return the diagnosis in one sentence."""
    if diagnosis.found:
        return f'Missing: {"; ".join(map(named, diagnosis.found))}.'
    if diagnosis.findings:
        first = diagnosis.findings[0]
        others = f'; alternative: {", ".join(first.rivals)}' if first.rivals else ''
        state = ('Predicted together with gravity already' if first.is_predicted
                 else f'Not established ({first.verdict})')
        return f'{state}: {named(first)}{others}.'
    name, worst = max(diagnosis.joints.items(), key=lambda item: item[1].remaining_share,
                      default=('', None))
    if worst is not None and worst.remaining_share > 0.0:
        return (f'No effect of the library explains the residual: the remaining error of joint '
                f'{name} is {worst.rmse_after:.3g} N·m, {percent(worst.remaining_share)} of the '
                f'torque range.')
    return 'Nothing is missing that is detectable in this motion.'


def named(finding: Finding) -> str:
    """Return the effect of a finding with its place and size."""
    if finding.effect is None:
        at = finding.setting.get('angle')
        near = '' if at is None else f' near {at:.2f} rad'
        return f'unexplained torque on {where(finding)}{near}'
    size = sizes(finding.coefficients)
    return f'{title(finding.effect)} on {where(finding)}{f" ({size})" if size else ""}'


def where(finding: Finding) -> str:
    """Return the joint of a finding, or 'the whole arm'."""
    return 'the whole arm' if finding.joint is None else f'joint {finding.joint}'


def title(effect: str) -> str:
    """Return the effect's title for use within a sentence; its name if it is not installed."""
    known = all_effects().get(effect)
    if known is None:
        return effect
    full = known.title
    first = full.split(' ')[0]
    # Proper names keep their capital.
    return full if first in ('Coulomb', 'Stribeck') else full[0].lower() + full[1:]


def sizes(coefficients: Mapping[str, Quantity], limit: int = _MAX_COEFFICIENTS) -> str:
    """Return coefficients with their intervals, '' for more than `limit` coefficients."""
    items = dict(coefficients)
    if not items or len(items) > limit:
        return ''
    if len(items) == 1:
        return plus_minus(next(iter(items.values())))
    return ', '.join(f'{symbol} {plus_minus(x)}' for symbol, x in items.items())


def coefficients(values: Mapping[str, Quantity], limit: int = 3) -> str:
    """
    Return `limit` coefficients with units and 95 % intervals, in one line.

    Of more, as of the harmonics of a ripple, they are those that differ most from 0. One that may
    be 0 is not shown.
    """
    items = list(values.items())
    if len(items) > limit:
        items.sort(key=lambda item: -abs(item[1].value) / max(item[1].half, 1e-12))
        items = [(symbol, x) for symbol, x in items[:limit] if abs(x.value) > x.half]
    texts = '; '.join(f'{symbol} = {plus_minus(x)}' for symbol, x in items)
    more = len(values) - len(items)
    if more:
        return f'{texts} and {more} more' if texts else f'{more} coefficients'
    return texts or '–'


def settings(effect: AppliedEffect) -> str:
    """Return the nonlinear parameters with a meaning: not the names of recordings or a clock."""
    units = all_effects()[effect.name].setting_units
    return ', '.join(f'{name} {x:.3g}' for name, x in effect.setting.items()
                     if name in units and name not in ('clock', 'recording'))


def plus_minus(estimate: Quantity) -> str:
    """Return `0.790 ± 0.028 N·m`, with two significant digits of the half-width."""
    half = estimate.half
    unit = f' {estimate.unit}' if estimate.unit else ''
    if not (math.isfinite(half) and half > 0.0):
        return f'{estimate.value:.4g}{unit}'
    digits = 1 - math.floor(math.log10(half))
    if digits > 6 or digits < -3:
        return f'{estimate.value:.3g} ± {half:.2g}{unit}'
    digits = max(digits, 0)
    return f'{estimate.value:.{digits}f} ± {half:.{digits}f}{unit}'


def change(finding: Finding) -> str:
    """Return the held-out error without and with an effect, with distinguishable digits."""
    before, after = finding.nrmse_before, finding.nrmse_after
    texts = percent(before), percent(after)
    if texts[0] == texts[1] and before != after:
        texts = f'{100.0 * before:.4f} %', f'{100.0 * after:.4f} %'
    return ' → '.join(texts)


def untestable(diagnosis: Diagnosis) -> list[str]:
    """Return a line for each effect and reason, with the joints on which it is untestable."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for name, report in diagnosis.joints.items():
        for effect, reason in report.untestable.items():
            grouped.setdefault((effect, reason), []).append(name)
    return [*(f'{effect}: {reason}' for effect, reason in diagnosis.untestable.items()), *(
        f'{effect} on '
        f'{"every joint" if len(names) == len(diagnosis.joints) else ", ".join(names)}: {reason}'
        for (effect, reason), names in grouped.items())]
