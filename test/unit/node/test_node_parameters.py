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


def test_the_documentation_is_current():
    assert (ROOT / 'docs' / 'parameters.md').read_text() == markdown()


def test_every_check_and_every_fault_of_the_input_is_documented():
    page = (ROOT / 'docs' / 'node.md').read_text()
    names = [value for name, value in vars(checks).items() if name.isupper()]
    assert len(names) == 18 and all(f'| {name} |' in page for name in names)
    assert all(f'`{reason}`' in page
               for reason in (*messages.FAULTS, *messages.REPLACED, *messages.HANDLED))


def test_the_documentation_needs_no_ros():
    code = ('import sys; sys.modules["rclpy"] = None; import runpy; '
            'runpy.run_path("docs/make_parameters.py", run_name="__main__")')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                          cwd=ROOT, check=True)
    assert done.stdout == markdown()


def test_defaults_are_allowed_by_the_table_itself():
    Parameters()
    for row in TABLE:
        assert row.parse(row.default) == row.default


@pytest.mark.parametrize('name, value, why', [
    ('max_speed', -1.0, 'must lie in 0.001 to 10'), ('max_speed', 'fast', 'of type double'),
    ('max_speed', float('nan'), 'must be finite'), ('max_speed', True, 'of type double'),
    ('full_samples', 90.5, 'whole number'), ('full_samples', 1, 'must lie in 20 to 1500'),
    ('formulation', 'magic', 'one of auto, potential, chain'), ('auto_fit', 1, 'true or false'),
    ('max_torque', 5.0, 'must be a list'), ('max_torque', [1.0, -1.0], 'must lie in 0'),
    ('max_torque', [1.0, float('inf')], 'must be finite'), ('joints', ['a', 'a'], 'differ'),
    ('joints', 'a', 'must be a list'), ('model_file', 3, 'must be text'),
    ('fade_time', None, 'of type double')])
def test_bad_values_are_refused_with_the_reason(name, value, why):
    with pytest.raises(OptionError, match=f'parameter {name}.*{why}'):
        BY_NAME[name].parse(value)


def test_all_formulations_can_be_fitted():
    for formulation in BY_NAME['formulation'].choices:
        assert FitOptions(formulation=formulation).formulation == formulation


def test_an_empty_list_in_yaml_is_an_empty_list():
    assert BY_NAME['max_torque'].parse(None) == () == BY_NAME['joints'].parse([])


def test_integers_are_accepted_for_doubles():
    assert BY_NAME['max_torque'].parse([1, 2.5]) == (1.0, 2.5)
    assert isinstance(BY_NAME['max_speed'].parse(1), float)


@pytest.mark.parametrize('change, why', [
    ({'joints': ('a', 'b'), 'max_torque': (1.0, 2.0, 3.0)}, 'max_torque: 3 values for 2'),
    ({'joints': ('a', 'b'), 'effort_scale': (1.0, 1.0, 1.0)}, 'effort_scale: 3 values for 2'),
    ({'joints': ('a', 'b'), 'continuous_joints': ('c',)}, 'continuous_joints: c'),
    ({'joints': tuple('abcdefghijk')}, 'at most 10'), ({'effort_scale': (0.0,)}, 'would erase'),
    ({'min_samples': 600}, 'more than full_samples'),
    ({'hold_time': float('nan')}, 'hold_time.*finite'),
    ({'extrapolation': 'guess'}, 'one of hold'),
    ({'extrapolation_margin': 0.0}, 'must lie in 0.01 to 10')])
def test_contradicting_values_are_refused(change, why):
    with pytest.raises(OptionError, match=why):
        Parameters(**change)


def test_the_example_configuration_is_accepted():
    values = yaml.safe_load((ROOT / 'config' / 'gravity_comp.yaml').read_text())
    given = values['/**']['ros__parameters']
    Parameters(**{k: BY_NAME[k].parse(v) for k, v in given.items()})
    controllers = yaml.safe_load((ROOT / 'config' / 'controllers.yaml').read_text())
    assert controllers['gravity_controller']['ros__parameters']['joints'] == given['joints']


def test_off_is_accepted_as_yaml_reads_it():
    assert BY_NAME['robot_description'].parse(False) == 'off'
    assert BY_NAME['robot_description'].parse('off') == 'off'
    for name, value in (('robot_description', True), ('model_file', False)):
        with pytest.raises(OptionError, match='it must be text'):
            BY_NAME[name].parse(value)
