"""The bench of thresholds: one is changed at a time, both ways."""

from dataclasses import asdict, replace

from bench.campaign import sensitivity
from bench.campaign.results import Task
from bench.campaign.sensitivity import AS_IT_IS, Count, counted, table, variants
from bench.cases.case_list import case
from gravity_comp_ros.diagnosis.options import DiagnosisOptions


def thresholds(options):
    return {**asdict(options.selection), **asdict(options.verdict)}


def test_each_threshold_is_halved_and_doubled_alone():
    usual, seen = thresholds(DiagnosisOptions()), []
    (name, as_it_is), *others = variants()
    assert name == AS_IT_IS and thresholds(as_it_is) == usual
    for name, options in others:
        (changed, value), = (set(thresholds(options).items()) - set(usual.items()))
        assert f'`{changed}`' in name and type(value) is type(usual[changed])
        seen.append((changed, value > usual[changed]))
    assert sorted(seen) == sorted((name, more) for name in usual for more in (False, True))


def test_a_threshold_can_make_a_finding_weak(monkeypatch):
    usual = DiagnosisOptions()
    strict = replace(usual, verdict=replace(usual.verdict, min_effective=1e9))
    monkeypatch.setattr(sensitivity, 'variants', lambda: [(AS_IT_IS, usual), ('strict', strict)])
    monkeypatch.setattr(sensitivity, 'SECONDS', 30.0)
    counts = counted(Task(replace(case('six_axis', 'coulomb_large'), runs=2), 3, 25.0))
    assert counts[AS_IT_IS].named == 1 and counts[AS_IT_IS].false == 0
    assert counts['strict'].named == 0
    assert counts['strict'].other == counts['strict'].recordings == 1
    total = counts[AS_IT_IS] + counts['strict']
    assert '1 of 2' in table({AS_IT_IS: total})
    assert str(Count(3, 2, 1, 4, 3, 2, 1)) == '2 of 3 | 3 of 4 | 1 | 1 of 2 | 0'
