"""Parameter table: accepted and refused values, and its documentation."""

from pathlib import Path
import subprocess
import sys

from docs.make_parameters import markdown
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.fit import FitOptions
from gravity_comp_ros.node import checks, messages
from gravity_comp_ros.node.parameters import BY_NAME, Parameters, TABLE
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]


def test_every_check_and_every_fault_of_the_input_is_documented():
    page = (ROOT / 'docs' / 'node.md').read_text()
    kinds = checks.FIT, checks.DIAGNOSIS, checks.PAYLOAD
    names = [value for name, value in vars(checks).items()
             if name.isupper() and isinstance(value, str) and value not in kinds]
    assert len(names) == 16 and all(f'| {name} |' in page for name in names)
    assert all(f'`{reason}`' in page
               for reason in (*messages.FAULTS, *messages.HANDLED))


def test_the_documentation_needs_no_ros():
    code = ('import sys; sys.modules["rclpy"] = None; import runpy; '
            'runpy.run_path("docs/make_parameters.py", run_name="__main__")')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                          cwd=ROOT, check=True)
    assert done.stdout == markdown() == (ROOT / 'docs' / 'parameters.md').read_text()


@pytest.mark.parametrize('name, value, why', [
    ('max_speed', -1.0, 'must lie in 0.001 to 10'), ('max_speed', 'fast', 'of type double'),
    ('max_speed', float('nan'), 'must be finite'), ('max_speed', True, 'of type double'),
    ('full_samples', 90.5, 'of type int'), ('full_samples', 1, 'must lie in 20 to 1500'),
    ('formulation', 'magic', 'one of auto, potential, chain'), ('auto_fit', 1, 'of type bool'),
    ('max_torque', 5.0, 'of type double'), ('max_torque', [1.0, -1.0], 'must lie in 0'),
    ('max_torque', [1.0, float('inf')], 'must be finite'), ('joints', ['a', 'a'], 'differ'),
    ('joints', 'a', 'of type string'), ('model_file', 3, 'of type string'),
    ('robot_description', True, 'of type string'), ('model_file', False, 'of type string'),
    ('fade_time', None, 'of type double')])
def test_bad_values_are_refused_with_the_reason(name, value, why):
    with pytest.raises(OptionError, match=f'parameter {name}.*{why}'):
        BY_NAME[name].parse(value)


@pytest.mark.parametrize('name, value, parsed', [
    ('max_torque', None, ()), ('joints', [], ()), ('max_torque', [1, 2.5], (1.0, 2.5)),
    ('robot_description', False, 'off'), ('robot_description', 'off', 'off')])
def test_values_as_yaml_reads_them_are_converted(name, value, parsed):
    assert BY_NAME[name].parse(value) == parsed
    assert isinstance(BY_NAME['max_speed'].parse(1), float)
    assert all(row.parse(row.default) == row.default for row in TABLE)


@pytest.mark.parametrize('change, why', [
    ({'joints': ('a', 'b'), 'max_torque': (1.0, 2.0, 3.0)}, 'max_torque: 3 values for 2'),
    ({'joints': ('a', 'b'), 'effort_scale': (1.0, 1.0, 1.0)}, 'effort_scale: 3 values for 2'),
    ({'joints': ('a', 'b'), 'continuous_joints': ('c',)}, 'continuous_joints: c'),
    ({'joints': tuple('abcdefghijk')}, 'at most 10'), ({'effort_scale': (0.0,)}, 'would erase'),
    ({'min_samples': 600}, 'more than full_samples'),
    ({'hold_time': float('nan')}, 'hold_time.*finite'),
    ({'stale_action': 'guess'}, 'one of fade'),
    ({'extrapolation_margin': 0.0}, 'must lie in 0.01 to 10')])
def test_contradicting_values_are_refused(change, why):
    with pytest.raises(OptionError, match=why):
        Parameters(**change)


def test_the_example_configuration_and_all_formulations_are_accepted():
    for path in (ROOT / 'config').glob('gravity_comp_*.yaml'):
        chosen = yaml.safe_load(path.read_text())['/**']['ros__parameters']
        values = Parameters(**{k: BY_NAME[k].parse(v) for k, v in chosen.items()})
        assert values.max_torque and values.joints, path.name
    given = yaml.safe_load((ROOT / 'config' / 'gravity_comp.yaml').read_text())['/**'][
        'ros__parameters']
    controllers = yaml.safe_load((ROOT / 'config' / 'controllers.yaml').read_text())
    assert controllers['gravity_controller']['ros__parameters']['joints'] == given['joints']
    for formulation in BY_NAME['formulation'].choices:
        assert FitOptions(formulation=formulation).formulation == formulation
