"""
Generator of docs/effects.md from the texts of the library.

`python3 docs/make_effects.py > docs/effects.md`
"""

from __future__ import annotations

from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.registry import library_effects

_HEAD = """# Effects

Physical effects in addition to gravity, which `gravity_comp diagnose` tests and `gravity_comp add`
adds to a model. This page is generated from the library by
`python3 docs/make_effects.py > docs/effects.md`.

Every effect is a torque that is linear in a few coefficients. Its columns are computed from the
motion and the predicted gravity torque g, never from the measured torque. Several values of its
nonlinear parameters (a speed, a distance, a time) are compared, and the best is used. q, qd and
qdd are angle, speed and acceleration in rad, rad/s and rad/s^2; n is the joint of the effect, N
the number of joints. Torque is that of the drive, positive in the direction of positive q.

- **d_n**, from -1 to 1, is the direction of motion. Its law is a nonlinear parameter: `width`,
  tanh(qd_n / width); `ramp`, qd_n / ramp limited to ±1, as in many simulators; or `distance`, a
  direction that persists at rest and reverses over a distance (Dahl's element). A width or ramp
  is at least the noise of the speed.
- **Acceleration** is the slope of a cubic fitted to the speed over 0.3 s, symmetric about each
  sample and within one run.
- **Time**: presliding friction starts again with every run. Warm-up and drift continue over
  recordings with stamps on one clock: `origin` is the time on that clock at which they began, so
  that a later recording is predicted where it lies in time. Without a clock they start again with
  every run.
- **Changes**: an encoder offset, a base tilt and a payload change begin at a `time` in s of a
  `run`, or at a `clock` time. Gravity is that of the end of the recording, and the effect is the
  difference before the change. Gravity absorbs an error that is there throughout.
- **Prior**: each coefficient has a normal prior about 0, cut at 0 if it cannot be negative. For
  torques and stiffnesses it is in proportion to the torque scale of the joint.
- An effect is *untestable* on a recording if the motion does not excite it. The reason is
  reported.

A package can provide its own effects through the entry-point group `gravity_comp_ros.effects`;
`examples/custom_effect` is a template. Effects that cannot be loaded are skipped and reported.
"""


def document() -> str:
    """Return docs/effects.md."""
    effects = library_effects()
    lines = [_HEAD, '| name | effect | acts on | coefficients |', '|---|---|---|---|']
    lines += [f'| [{name}](#{name}) | {effect.title} | {_acts_on(effect)} | '
              f'{", ".join(c.symbol for c in effect.coefficients)} |'
              for name, effect in effects.items()]
    for effect in effects.values():
        lines += ['', *_section(effect)]
    return '\n'.join(lines) + '\n'


def _section(effect: Effect) -> list[str]:
    varies = type(effect).coefficients_of is not Effect.coefficients_of
    more = ' (and further coefficients of these kinds)' if varies else ''
    lines = [f'## {effect.name}', '', f'**{effect.title}.** {effect.description}', '',
             f'    {effect.equation}', '']
    lines += [f'- `{c.symbol}` {f"in {c.unit}" if c.unit else "(no unit)"}: {c.meaning}'
              for c in effect.coefficients]
    lines[-1] += more
    if effect.setting_units:
        lines.append('- nonlinear parameters: ' + ', '.join(
            f'{name} in {unit}' if unit else name
            for name, unit in effect.setting_units.items()))
    if effect.is_shared:
        lines.append('- estimated by every fit, not selected')
    if effect.corrects:
        lines.append('- corrects one of: ' + _links(effect.corrects))
    if effect.why_not_negative:
        lines.append(f'- not negative: {effect.why_not_negative}')
    lines.append(f'- plot of the residual over: {effect.signature}')
    if effect.confounders:
        lines.append('- confounders: ' + _links(effect.confounders))
    lines += [f'- decisive experiment: {effect.experiment.replace("{joint}", "n")}',
              f'- source: {effect.source}']
    return lines


def _links(names: tuple[str, ...]) -> str:
    return ', '.join(f'[{name}](#{name})' for name in names)


def _acts_on(effect: Effect) -> str:
    if effect.scope == 'joint':
        return 'the joint'
    return 'all joints, from one joint' if effect.per_joint else 'all joints'


if __name__ == '__main__':
    print(document(), end='')
