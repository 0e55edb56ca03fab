"""
docs/effects.md, made from the library itself.

`python3 docs/make_effects.py > docs/effects.md`
"""

from __future__ import annotations

from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.registry import library_effects

_HEAD = """# Effects

What a torque can hold besides gravity: the library that `gravity_comp diagnose` chooses from and
`gravity_comp add` adds from. This page is made from the library by
`python3 docs/make_effects.py > docs/effects.md`.

Every effect is a torque that is linear in a few coefficients, with columns computed from the
motion and from the predicted gravity torque g, never from the measured one. What an effect is
not linear in (a speed, a distance, a time) is a setting: several are tried and the best is taken.
q, qd, qdd are angle, speed and acceleration in rad, rad/s and rad/s^2; n is the joint that the
effect is about, of N. Torque is positive in the direction of positive q, as the drive supplies it.

- **d_n**, from -1 to 1, is the direction of motion. It is tanh(qd_n / width), with a width of
  three times the noise of the measured speed and at least 2 mrad/s. Where friction is plain to
  see, the shape that fits best is taken: another width, or a direction that holds on while the
  joint stands and turns within at most 0.5 mrad of motion.
- **Acceleration** is the slope of a cubic fitted to the speed over 0.3 s, half before and half
  after, never across the border of two runs.
- **Runs**: whatever has a memory (warming, drift, friction that builds up) starts anew with every
  run. A payload that has changed stays changed in the runs that follow.
- An effect can be *untestable* on a recording: the motion does not show it. The tool says why.

A package can bring effects of its own, through the entry-point group `gravity_comp_ros.effects`;
`examples/custom_effect` is one that can be copied. Effects that cannot be loaded are left out
with a line that says why.
"""


def document() -> str:
    """Return docs/effects.md."""
    effects = library_effects()
    lines = [_HEAD, '| name | what it is | acts on | coefficients |', '|---|---|---|---|']
    lines += [f'| [{name}](#{name}) | {effect.title} | {_acts_on(effect)} | '
              f'{", ".join(c.symbol for c in effect.coefficients)} |'
              for name, effect in effects.items()]
    for effect in effects.values():
        lines += ['', *_section(effect)]
    return '\n'.join(lines) + '\n'


def _section(effect: Effect) -> list[str]:
    many = '' if effect.has_fixed_coefficients else ' (and others of their kinds)'
    lines = [f'## {effect.name}', '', f'**{effect.title}.** {effect.description}', '',
             f'    {effect.equation}', '']
    lines += [f'- `{c.symbol}` {f"in {c.unit}" if c.unit else "(no unit)"}: {c.meaning}'
              for c in effect.coefficients]
    lines[-1] += many
    if effect.setting_units:
        lines.append('- settings: ' + ', '.join(
            f'{name} in {unit}' if unit else name
            for name, unit in effect.setting_units.items()))
    lines += [f'- shows when the residual is plotted over: {effect.signature}',
              '- can look like: ' + ', '.join(
                  f'[{name}](#{name})' for name in effect.confounders),
              f'- what settles it: {effect.experiment.replace("{joint}", "n")}',
              f'- source: {effect.source}']
    return lines


def _acts_on(effect: Effect) -> str:
    if effect.scope == 'joint':
        return 'the joint'
    return 'all joints, from one joint' if effect.per_joint else 'all joints'


if __name__ == '__main__':
    print(document(), end='')
