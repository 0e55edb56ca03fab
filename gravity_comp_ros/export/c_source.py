"""
A gravity model as one C99 header and one C99 source.

The code needs the C library's mathematics alone. It allocates nothing, and every loop runs over
the joints or the numbers of the model. It compiles as C++ too, and with `GC_REAL=float`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import re

from gravity_comp_ros import __version__
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.export import c_text
from gravity_comp_ros.export.effect_code import effect_code, EffectCode
from gravity_comp_ros.export.gravity_code import gravity_code, Numbers
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import checksum
from gravity_comp_ros.printable import printable

_PREFIX = re.compile(r'[a-z][a-z0-9_]{0,30}')
_IN_MOTION = ', in motion only: 0 at rest'


@dataclass(frozen=True, eq=False)
class CSource:
    """
    Text of a header and a source, with their file names.

    `effects` are the exported effects, `left_out` the others with the reason. `in_motion` are
    those of `effects` that persist at rest in the model and vanish there in the code.
    """

    header_name: str
    header: str
    source_name: str
    source: str
    parameters: Numbers
    effects: tuple[str, ...]
    left_out: Mapping[str, str]
    in_motion: tuple[str, ...]


def parameters_of(model: GravityModel) -> Numbers:
    """
    Return the numbers of a model in the order that `gc_set_parameters` takes.

    First the trained range: the smallest angle of every joint, then the largest, in rad. Then the
    numbers of gravity (`gravity_code`). Then, effect by effect, its coefficients and nonlinear
    parameters. The labels name every number with its unit.
    """
    return _program(model)[2]


def c_source(model: GravityModel, prefix: str = 'gc') -> CSource:
    """
    Return the C source of a model.

    :param prefix: of all names, for a program with several arms; lower case.
    :raises OptionError: if the prefix is not a C name in lower case.
    """
    if not _PREFIX.fullmatch(prefix):
        raise OptionError(f'prefix {printable(prefix)!r} is not a C name: it takes lower-case '
                          f'letters, digits and _, and begins with a letter')
    gravity, effects, numbers = _program(model)
    code = _code(gravity, effects, numbers)
    texts = {'HEADER': f'{prefix}_gravity.h', **_texts(model, effects, numbers, prefix)}
    header, source = (_filled(_renamed(_filled(template, code), prefix), texts)
                      for template in (c_text.HEADER, c_text.SOURCE))
    return CSource(f'{prefix}_gravity.h', header, f'{prefix}_gravity.c', source, numbers,
                   effects.included, effects.left_out, effects.in_motion)


def _program(model: GravityModel) -> tuple[str, EffectCode, Numbers]:
    """Return the statements of gravity and of the effects, and the numbers in their order."""
    numbers = Numbers()
    for word, limits in (('min', model.coverage.q_min), ('max', model.coverage.q_max)):
        numbers.add_all((f'{joint} q_{word} rad' for joint in model.joints), limits)
    return gravity_code(model, numbers), effect_code(model, numbers), numbers


def _code(gravity: str, effects: EffectCode, numbers: Numbers) -> dict[str, str]:
    """Return the code of each place in the templates; its names get the prefix."""
    static, friction = '\n'.join(effects.static), '\n'.join(effects.friction)
    checks = [f'    if (!(values[{k}] > 0.0)) return GC_NOT_POSITIVE;' for k in numbers.positive]
    if numbers.rotations is not None:
        checks.append(_filled(c_text.CHECK_ROTATIONS, {'A': str(numbers.rotations)}))
    return {'GRAVITY': gravity, 'STATIC': static, 'CHECKS': '\n'.join(checks),
            'FRICTION': '    gc_gravity(q, g);\n' * ('g[' in friction) + friction,
            'HELPERS': '\n'.join(text for name, text in c_text.FUNCTIONS.items()
                                 if f'{name}(' in static + friction)}


def _texts(model: GravityModel, effects: EffectCode, numbers: Numbers,
           prefix: str) -> dict[str, str]:
    """Return the texts of the model, which may contain any names."""
    return {
        'VERSION': __version__, 'SHA256': checksum(model), 'N': str(model.n_joints),
        'COUNT': str(len(numbers.labels)), 'LAYOUT': f'0x{numbers.layout:08x}',
        'FORMULATION': model.formulation,
        'JOINT_LIST': '\n'.join(
            f' *   {k}  {_comment(joint)}: {low:+.4f} to {high:+.4f} rad' for k, (joint, low, high)
            in enumerate(zip(model.joints, model.coverage.q_min, model.coverage.q_max))),
        'EFFECT_LIST': _listed([f'{target}{_IN_MOTION * (target in effects.in_motion)}'
                                for target in effects.included]),
        'LEFT_OUT': _listed([f'{target}: {why}' for target, why in effects.left_out.items()]),
        'NAMES': ', '.join(_string(joint) for joint in model.joints),
        'VALUES': '\n'.join(
            f'    {prefix.upper()}_C({value!r}),{" " * max(1, 26 - len(repr(value)))}/* {k:4d}  '
            f'{_comment(label)} */'
            for k, (label, value) in enumerate(zip(numbers.labels, numbers.values.tolist())))}


def _filled(template: str, texts: Mapping[str, str]) -> str:
    """Return a template with these texts in their places, and the other places."""
    return re.sub(r'@([A-Z0-9_]+)@', lambda place: texts.get(place[1], place[0]), template)


def _renamed(code: str, prefix: str) -> str:
    code = re.sub(r'\bgc_', f'{prefix}_', code)
    return re.sub(r'\bGC_', f'{prefix.upper()}_', code)


def _listed(lines: list[str]) -> str:
    return '\n'.join(f' *   {_comment(line)}' for line in lines or ['none'])


def _comment(text: str) -> str:
    """Return text that can stand in a C comment."""
    return re.sub(r'\?(?=\?)', '? ', printable(text).replace('*/', '* /').replace('/*', '/ *'))


def _string(text: str) -> str:
    """Return a C string literal; bytes outside of plain ASCII are octal escapes."""
    plain = ''.join(chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?'
                    else f'\\{byte:03o}' for byte in text.encode())
    return f'"{plain}"'
