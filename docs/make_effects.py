"""
Generator of docs/effects.md from the texts of the library.

`python3 docs/make_effects.py > docs/effects.md`
"""

from __future__ import annotations

from gravity_comp_ros.effects.change_points import UNITS
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.motion_direction import LAW_UNITS
from gravity_comp_ros.effects.registry import library_effects

_HEAD = """# Effects

To see what an effect that `gravity_comp diagnose` names means, how it is confirmed, and what it is
confused with. Generated from the library by `python3 docs/make_effects.py > docs/effects.md`.

Every effect is a torque that is linear in a few coefficients, positive in the direction of
positive q, and computed from the motion and the predicted gravity torque g, never from the
measured torque. q, qd and qdd are angle, speed and acceleration in rad, rad/s and rad/s^2; n is
the joint of the effect, N the number of joints. The best of several values of its nonlinear
parameters is used.

- **d_n**, from -1 to 1, is the direction of motion: tanh(qd_n / `width`), qd_n / `ramp` limited to
  ±1 (both in rad/s), or a direction that persists at rest and reverses over a `distance` in rad
  (Dahl's element).
- **Time**: recordings with stamps on one clock are one session, from the time `origin` in s on;
  otherwise every run is one. Presliding friction starts again with every run.
- **Changes** (encoder offset, base tilt, payload change) begin at a `time` in s of a `run`, or at
  a `clock` time in s. Gravity is that of the end of the recording, and absorbs an error that is
  there throughout.

The experiment distinguishes an effect from its confounders. An effect that the motion does not
excite is *untestable*, with the reason. The literature is the attribute `source` of each class
(`gravity_comp_ros/effects/`). Your own effects:
[examples/custom_effect](../examples/custom_effect); effects that cannot be loaded are skipped.
"""

# Nonlinear parameters that the head of the page explains.
_SHARED = {**LAW_UNITS, **UNITS, 'origin': 's'}


def document() -> str:
    """Return docs/effects.md."""
    effects = library_effects()
    lines = [_HEAD]
    for scope in ('the joint', 'all joints'):
        names = tuple(name for name, effect in effects.items() if _acts_on(effect) == scope)
        lines.append(f'- on {scope}: {_links(names)}')
    for effect in effects.values():
        lines += ['', *_section(effect)]
    return '\n'.join(lines) + '\n'


def _section(effect: Effect) -> list[str]:
    varies = type(effect).coefficients_of is not Effect.coefficients_of
    more = ' (and further ones of these kinds)' if varies else ''
    lines = [f'## {effect.name}', '', effect.description, '',
             f'    {effect.equation}', '']
    sign = ', not negative' if effect.why_not_negative else ''
    lines += [f'- `{c.symbol}` {f"in {c.unit}" if c.unit else "(no unit)"}{sign}: {c.meaning}'
              for c in effect.coefficients]
    lines[-1] += more
    parameters = [f'{name} in {unit}' if unit else name
                  for name, unit in effect.setting_units.items() if name not in _SHARED]
    if parameters:
        lines.append('- nonlinear parameters: ' + ', '.join(parameters))
    if effect.is_shared:
        lines.append('- estimated by every fit, not selected')
    if effect.corrects:
        lines.append('- corrects: ' + _links(effect.corrects))
    if effect.confounders:
        lines.append('- confounders: ' + _links(effect.confounders))
    lines.append(f'- experiment: {effect.experiment.replace("{joint}", "n")}')
    return lines


def _links(names: tuple[str, ...]) -> str:
    return ', '.join(f'[{name}](#{name})' for name in names)


def _acts_on(effect: Effect) -> str:
    return 'the joint' if effect.scope == 'joint' else 'all joints'


if __name__ == '__main__':
    print(document(), end='')
