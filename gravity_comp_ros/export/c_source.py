"""
A gravity model as one C99 header and one C99 source.

The code needs the C library's mathematics alone. It allocates nothing, and every loop runs over
the joints or the numbers of the model. It compiles as C++ too, and with `GC_REAL=float`.
"""

from __future__ import annotations

from dataclasses import dataclass
import re

from gravity_comp_ros import __version__
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.export import c_text
from gravity_comp_ros.export.effect_code import effect_code, EffectCode
from gravity_comp_ros.export.gravity_code import gravity_code
from gravity_comp_ros.export.numbers import Numbers
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import checksum
from gravity_comp_ros.printable import printable

# Sines and cosines of the pose in a statement.
_TRIG = re.compile(r'\b[sc]\[')
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
    left_out: dict[str, str]
    in_motion: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Program:
    """The statements of a model, and its numbers in their order."""

    gravity: str
    effects: EffectCode
    numbers: Numbers
    rotations: int


def parameters_of(model: GravityModel) -> Numbers:
    """
    Return the numbers of a model in the order that `gc_set_parameters` takes.

    First the trained range: the smallest angle of every joint, then the largest, in rad. Then the
    numbers of gravity (`gravity_code`). Then, effect by effect, its coefficients and nonlinear
    parameters. The labels name every number with its unit.
    """
    return _program(model).numbers


def c_source(model: GravityModel, prefix: str = 'gc') -> CSource:
    """
    Return the C source of a model.

    :param prefix: of all names, for a program with several arms; lower case.
    :raises OptionError: if the prefix is not a C name in lower case.
    """
    if not _PREFIX.fullmatch(prefix):
        raise OptionError(f'prefix {printable(prefix)!r} is not a C name: it takes lower-case '
                          f'letters, digits and _, and begins with a letter')
    program = _program(model)
    texts = {'HEADER': f'{prefix}_gravity.h', **_texts(model, program)}
    header, source = (_filled(template, prefix, texts)
                      for template in (c_text.HEADER, c_text.SOURCE))
    return CSource(f'{prefix}_gravity.h', header, f'{prefix}_gravity.c', source, program.numbers,
                   program.effects.included, dict(program.effects.left_out),
                   program.effects.in_motion)


def _program(model: GravityModel) -> _Program:
    numbers = Numbers()
    for word, limits in (('min', model.coverage.q_min), ('max', model.coverage.q_max)):
        numbers.add_all((f'{joint} q_{word} rad' for joint in model.joints), limits)
    gravity = gravity_code(model, numbers)
    # The rotations are the last numbers of a chain's gravity.
    rotations = len(numbers.labels) - 9 * model.n_joints if model.chain is not None else -1
    return _Program(gravity, effect_code(model, numbers), numbers, rotations)


def _texts(model: GravityModel, program: _Program) -> dict[str, str]:
    """Return the text of each place in the templates."""
    effects, numbers = program.effects, program.numbers
    static, friction = '\n'.join(effects.static), '\n'.join(effects.friction)
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
            f'    GC_C({value!r}),{" " * max(1, 26 - len(repr(value)))}/* {k:4d}  '
            f'{_comment(label)} */'
            for k, (label, value) in enumerate(zip(numbers.labels, numbers.values.tolist()))),
        'HELPERS': _helpers(static + friction), 'GRAVITY': program.gravity,
        'STATIC': _with_gravity(static),
        'FRICTION': _friction(friction),
        'CHECKS': _checks(program)}


def _with_gravity(lines: str) -> str:
    """Return statements that set tau to gravity and add the static effects."""
    if not lines:
        return '    gc_gravity(q, tau);'
    declared = '    gc_real s[GC_N], c[GC_N];\n' if _TRIG.search(lines) else ''
    trig = c_text.SINES if declared else ''
    return f'{declared}    gc_real g[GC_N];\n{c_text.COPY_GRAVITY}\n{trig}{lines}'


def _friction(lines: str) -> str:
    unused = ''.join(f'    (void){name};\n' for name in ('q', 'qd')
                     if not re.search(rf'\b{name}\[', lines) and not (
                         name == 'q' and 'g[' in lines))
    gravity = '    gc_gravity(q, g);\n' if 'g[' in lines else ''
    declared = '    gc_real g[GC_N];\n' if gravity else ''
    zero = '    int i;\n    for (i = 0; i < GC_N; ++i) tau[i] = GC_C(0.0);\n'
    return f'{declared}{zero}{unused}{gravity}{lines}'.rstrip('\n')


def _helpers(code: str) -> str:
    return '\n'.join(text for name, text in c_text.FUNCTIONS.items() if f'{name}(' in code)


def _checks(program: _Program) -> str:
    lines = [f'    if (!(values[{k}] > 0.0)) return GC_NOT_POSITIVE;'
             for k in program.numbers.positive]
    if program.rotations >= 0:
        lines.append(c_text.CHECK_ROTATIONS.replace('@A@', str(program.rotations)))
    return '\n'.join(lines)


def _filled(template: str, prefix: str, texts: dict[str, str]) -> str:
    """Return a template with names of this prefix; texts from the model are inserted last."""
    own = ('JOINT_LIST', 'EFFECT_LIST', 'LEFT_OUT', 'NAMES', 'HEADER')
    for key in texts.keys() - set(own) - {'VALUES'}:
        template = template.replace(f'@{key}@', texts[key])
    template = _renamed(template, prefix)
    # Labels of numbers and names of joints must not be renamed.
    values = texts['VALUES'].replace('GC_C(', f'{prefix.upper()}_C(')
    for key, text in {**{k: texts[k] for k in own}, 'VALUES': values}.items():
        template = template.replace(f'@{key}@', text)
    return template


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
