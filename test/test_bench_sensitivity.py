"""Sensitivity of the diagnosis: one threshold at a time is halved and doubled."""

from dataclasses import asdict, replace

from bench.campaign import sensitivity
from bench.campaign.results import Task
from bench.campaign.sensitivity import Count, counted, table, UNCHANGED, variants
from bench.cases.case_list import case
from gravity_comp_ros.diagnosis.options import DiagnosisOptions


def thresholds(options):
    return {**asdict(options.selection), **asdict(options.verdict)}


def test_each_threshold_is_halved_and_doubled_alone():
    defaults, changes = thresholds(DiagnosisOptions()), []
    (name, unchanged), *others = variants()
    assert name == UNCHANGED and thresholds(unchanged) == defaults
    for name, options in others:
        (changed, value), = (set(thresholds(options).items()) - set(defaults.items()))
        assert f'`{changed}`' in name and type(value) is type(defaults[changed])
        changes.append((changed, value > defaults[changed]))
    assert sorted(changes) == sorted((name, up) for name in defaults for up in (False, True))


def test_a_threshold_can_make_a_finding_weak(monkeypatch):
    default = DiagnosisOptions()
    strict = replace(default, verdict=replace(default.verdict, min_effective=1e9))
    monkeypatch.setattr(sensitivity, 'variants',
                        lambda: [(UNCHANGED, default), ('strict', strict)])
    monkeypatch.setattr(sensitivity, 'SECONDS', 30.0)
    counts = counted(Task(replace(case('six_axis', 'coulomb_large'), runs=2), 3, 25.0))
    assert counts[UNCHANGED].named == 1 and counts[UNCHANGED].false == 0
    assert counts['strict'].named == 0
    assert counts['strict'].changed == counts['strict'].recordings == 1
    total = counts[UNCHANGED] + counts['strict']
    assert '1 of 2' in table({UNCHANGED: total})
    assert str(Count(3, 2, 1, 4, 3, 2, 1)) == '2 of 3 | 3 of 4 | 1 | 1 of 2 | 0'
