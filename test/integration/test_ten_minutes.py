"""The scripts of docs/ten_minutes.md and of `make demo`."""

from importlib.util import find_spec
import json
from pathlib import Path
import re
import subprocess
import sys

from bench.shared.rough_links import two_link_urdf
from examples.ten_minutes import Arm, main, SLOW, targets
import pytest


def test_two_visits_are_filed_and_the_risen_friction_is_shown(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('examples.ten_minutes.SLOW', (*SLOW[:-3], '10', '--duration', '60'))
    # The page of the second visit would take seconds again; without Bokeh there is none.
    has_bokeh = find_spec('bokeh') is not None
    found = iter((has_bokeh or None, None))
    monkeypatch.setattr('examples.ten_minutes.find_spec', lambda name: next(found))
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(two_link_urdf(masses=(1.53, 1.02)))
    assert main(['seven', '--simulate', str(urdf), '--folder', str(tmp_path)]) == 0
    out = capsys.readouterr().out
    first, second = sorted(path for path in (tmp_path / 'seven').iterdir() if path.is_dir())
    assert [(visit / 'report.html').exists() for visit in (first, second)] == [has_bokeh, False]
    for visit in (first, second):
        files = {path.name for path in visit.iterdir()}
        assert files >= {'arm.json', 'findings.json', 'judged.json'}
        judged = json.loads((visit / 'judged.json').read_text())
        assert all(one['rmse'] < 0.1 for one in judged['joints'].values())
    assert json.loads((first / 'judged.json').read_text())['previous'] is None
    changed = [one for one in json.loads((second / 'judged.json').read_text())['previous'][
        'coefficients'] if one['drifted'] and one['symbol'] == 'F_c']
    assert [one['target'] for one in changed] == ['coulomb_friction:elbow']
    assert changed[0]['before']['value'] == pytest.approx(0.8, rel=0.05)
    assert changed[0]['after']['value'] == pytest.approx(1.2, rel=0.05)
    assert 'coulomb_friction:elbow F_c: 0.' in out and str(second) in out
    assert {path.name for path in (tmp_path / 'seven').iterdir()} == {
        first.name, second.name, 'first.json', 'motion.yaml'}


def test_a_step_that_fails_files_nothing(tmp_path, capsys):
    assert main(['arm', 'missing.mcap', '--judge', 'second.mcap', '--folder',
                 str(tmp_path)]) == 1
    assert 'no such file: missing.mcap' in capsys.readouterr().err
    (tmp_path / 'bad.mcap').write_text('no recording')
    (tmp_path / 'file').touch()
    for words, message in ((['--judge', str(tmp_path / 'file')], 'bad.mcap'), ([], 'bad.mcap'),
                           (['--folder', str(tmp_path / 'file')], 'cannot make the folder')):
        assert main(['arm', str(tmp_path / 'bad.mcap'), '--folder', str(tmp_path), *words]) == 1
        assert message in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bad.mcap', 'file']


@pytest.mark.parametrize('words', [['arm'], ['../arm', 'a.mcap'], ['first.mcap', 'second.mcap'],
                                   ['arm', 'a.mcap', '--simulate', 'b.urdf']])
def test_wrong_usage_is_refused(words, capsys):
    with pytest.raises(SystemExit) as refused:
        main(words)
    assert refused.value.code == 2


def test_what_the_diagnosis_suggests_is_added_once():
    findings = [['coulomb_friction:a', 'viscous_friction:a'], [], ['base_tilt'],
                ['viscous_friction:a']]
    assert targets({'findings': [{'to_add': names} for names in findings]}) == [
        'coulomb_friction:a', 'viscous_friction:a', 'base_tilt']


def test_earlier_models_are_found_in_order(tmp_path):
    for name in ('2026-02-01', '2026-01-01-2', '2026-01-01'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'arm.json').touch()
    assert [path.parent.name for path in Arm(tmp_path, None).models()] == [
        '2026-01-01', '2026-01-01-2', '2026-02-01']


ROOT = Path(__file__).resolve().parents[2]
DEADLINE = 400.0


def test_the_payload_raises_the_error_of_the_demo_and_relearning_lowers_it():
    done = subprocess.run([sys.executable, str(ROOT / 'examples' / 'demo.py')],
                          capture_output=True, text=True, timeout=DEADLINE, cwd=ROOT)
    assert done.returncode == 0 and done.stderr == '', done.stdout + done.stderr
    assert 'Worst joint with the stale model: iiwa_joint_2' in done.stdout
    # Errors as learned, stale, after 10 s and after 75 s, in N·m.
    rows = {name: [float(cell) for cell in cells.split()] for name, cells in re.findall(
        r'^ ?(iiwa_joint_\d)((?: +\d+\.\d{3}){4})', done.stdout, re.MULTILINE)}
    assert sorted(rows) == [f'iiwa_joint_{n}' for n in range(1, 8)]
    # 2 kg at the flange are about 10 N·m at the shoulder on this motion; 0.1 N·m is noise.
    learned, stale, quick, relearned = rows['iiwa_joint_2']
    assert stale > 5.0 and quick < stale / 2
    assert all(row[0] < 0.2 and row[3] < 0.2 for row in rows.values())
