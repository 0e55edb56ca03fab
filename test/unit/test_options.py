"""Options out of range are refused in one line, by the name of the field."""

from dataclasses import fields
from importlib import import_module
from pathlib import Path
import re

from gravity_comp_ros.calibration.known_weight import CalibrationOptions, Weight
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.models.sparse.admm import AdmmOptions
from gravity_comp_ros.planning.workspace import PlanOptions
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.recordings.table import TableOptions
from gravity_comp_ros.simulation.synthesise import NoiseOptions
import numpy as np
import pytest

NAN, INF = float('nan'), float('inf')


ROOT = Path(__file__).resolve().parents[2]
# A class all of whose numbers are positive.
CHECKED = re.compile(r"class (\w+):(?:(?!\nclass ).)*check_positive\(self, '[\w ]+'\)", re.DOTALL)


def checked_options():
    """Return the classes of options of the package all of whose numbers are positive."""
    return [getattr(import_module('.'.join(path.relative_to(ROOT).with_suffix('').parts)), name)
            for path in sorted((ROOT / 'gravity_comp_ros').rglob('*.py'))
            for name in CHECKED.findall(path.read_text())]


POSITIVE = checked_options()


@pytest.mark.parametrize('options', [CalibrationOptions, *POSITIVE])
@pytest.mark.parametrize('value', [0.0, -1.0, NAN, INF])
def test_constants_are_positive(options, value):
    assert len(POSITIVE) > 10
    for field in fields(options):
        if not isinstance(field.default, bool):
            with pytest.raises(OptionError, match=field.name) as caught:
                options(**{field.name: value})
            assert '\n' not in str(caught.value)


@pytest.mark.parametrize('options, wrong, message', [
    *((AdmmOptions, {name: value}, name.split('_')[0]) for name, values in {
        'max_iterations': [0], 'polish_every': [0], 'tolerance': [0.0, 1.1, NAN],
        'over_relaxation': [0.9, 2.0], 'rho': [0.0, -1.0, INF, NAN]}.items() for value in values),
    (FitOptions, {'formulation': 'magic'},
     "unknown formulation 'magic'; choose from auto, per_joint"),
    (GateOptions, {'max_speed': 0.0}, 'max_speed'), (GateOptions, {'max_speed': NAN}, 'max_speed'),
    (GateOptions, {'max_speed': ()}, 'max_speed'), (GateOptions, {'rate_hz': -1.0}, 'rate_hz'),
    *((PlanOptions, wrong, message) for wrong, message in (
        ({'duration': 0.0}, 'duration'), ({'max_speed': -1.0}, 'max_speed'),
        ({'max_jerk': NAN}, 'max_jerk'), ({'reach': 0.0}, 'reach is 0.0'),
        ({'low': np.zeros(3)}, 'both low and high'),
        ({'low': np.ones(3), 'high': np.zeros(3)}, 'low must not exceed high'),
        ({'start': np.full(3, NAN)}, 'start pose is not finite'))),
    (NoiseOptions, {'relative': -1.0}, 'relative'), (NoiseOptions, {'absolute': NAN}, 'absolute'),
    (NoiseOptions, {'absolute': INF}, 'absolute'),
    *((Weight, {'link': 'a', 'mass': mass}, 'must be positive') for mass in (0.0, -1.0, INF, NAN)),
    (Weight, {'link': 'a', 'mass': 1.0, 'centre': (0.0, NAN, 0.0)}, 'not finite'),
    *((ReadOptions, wrong, message) for wrong, message in (
        ({'effort_scale': {'a': 0.0}}, 'effort scale'),
        ({'effort_scale': {'a': NAN}}, 'effort scale'), ({'joints': ()}, 'joints'),
        ({'joints': ('a', 'a')}, 'joint'), ({'max_messages': 0}, 'messages to read'),
        ({'effort_unit': 'A'}, 'effort unit'), ({'effort_unit': 'percent'}, 'rated torque'),
        ({'rated_torque': {'a': 20.0}}, 'rated torque'), ({'position_unit': 'grad'}, 'position'),
        ({'position_unit': 'ticks=0'}, 'position unit'), ({'position_unit': 'ticks'}, 'position'),
        ({'position_unit': {'a': 'turn'}}, 'position unit'),
        ({'rename': {'a': 'x', 'b': 'x'}}, 'the same name'),
        ({'accept': ('spikes',)}, 'no kind of fact is named spikes'))),
    *((TableOptions, wrong, message) for wrong, message in (
        ({'rate': 0}, 'rate'), ({'rate': 10.0, 'time': 't'}, 'not both'),
        ({'time_unit': 'h'}, 'time unit'), ({'effort_sign': (2.0,)}, 'sign'),
        ({'effort_unit': 'A'}, 'torque constant'), ({'torque_constant': (1.0,)}, 'A or mA'),
        ({'delimiter': ',,'}, 'one character'), ({'gear_ratio': (NAN,)}, 'gear'),
        ({'effort_unit': 'A', 'torque_constant': (0.0,)}, 'torque constant'))),
    (TableOptions, {'effort_unit': 'percent'}, 'needs a rated torque'),
    (TableOptions, {'rated_torque': (3.0,)}, 'is for effort in percent')])
def test_values_out_of_range(options, wrong, message):
    with pytest.raises(OptionError, match=message) as caught:
        options(**wrong)
    assert '\n' not in str(caught.value)
