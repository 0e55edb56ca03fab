"""Data of report plots, computed without Bokeh, against analytic values."""

from bench.shared.rough_links import COULOMB, two_links, VISCOUS
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.diagnosis.findings import Finding
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.effects.predict import motion_of, predict_torque
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import keep_extremes
from gravity_comp_ros.report.views.effects import added_variable
from gravity_comp_ros.report.views.residuals import over_angle
from hypothesis import given, strategies as st
import numpy as np
import pytest


@given(st.integers(0, 2 ** 32 - 1), st.integers(500, 5000), st.integers(1, 6))
def test_no_peak_is_lost(seed, m, k):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(m, k))
    peaks = rng.integers(0, m, k)
    values[peaks, np.arange(k)] = rng.choice([-50.0, 50.0], k)
    runs = np.sort(rng.integers(0, 3, m))
    rows = keep_extremes(runs, values, 200)
    assert (np.diff(rows) > 0).all() and len(rows) <= 320
    assert set(peaks) <= set(rows)
    for run in np.unique(runs):
        samples = np.flatnonzero(runs == run)
        assert samples[0] in rows and samples[-1] in rows


def test_a_ripple_is_found_at_its_order_and_amplitude():
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.5, 1.5, 4000)
    order, amplitude = over_angle(q, 0.2 * np.sin(24 * q + 1.0) + rng.normal(0, 0.02, 4000))
    place = np.argmax(amplitude)
    assert abs(order[place] - 24.0) < 1.1 and 0.17 < amplitude[place] < 0.21
    # A joint at rest has no spectrum.
    assert len(over_angle(np.full(100, 0.4), np.ones(100))[0]) == 0


def _finding(effect, joint, **setting):
    return Finding(joint, effect, 'established', (), {}, 0.1, 0.05, 0.0, 1.0, '', '',
                   setting=setting)


def test_friction_gives_the_line_of_its_added_variable_plot():
    samples = concatenate([two_links(1), two_links(2)])
    model = fit(samples).model
    rows = np.arange(0, samples.n_samples, 3)
    motion = motion_of(model, samples)
    friction = _finding('coulomb_friction', 'shoulder', width=0.005)
    viscous = _finding('viscous_friction', 'shoulder')
    residual = samples.tau - predict_torque(model, samples)

    def of(finding, *others):
        return added_variable(motion, model.joints, residual, finding, others, rows)

    joint, x, y = of(friction, viscous)
    assert joint == 'shoulder' and x.shape == rows.shape
    # The explained torque has the size of the friction, with a small residual.
    assert (y - x).var() < 0.15 * y.var() and 0.2 * COULOMB < x.std() < COULOMB
    absent = _finding('coulomb_friction', 'elbow', width=0.005)
    _, x, y = of(absent)
    assert (y - x).var() > 0.9 * y.var()
    assert of(_finding('no_such_effect', 'elbow')) is None
    # Effects of the whole arm have many columns, which may not absorb the speed of one joint.
    _, x, y = of(viscous, friction, _finding('rigid_body_dynamics', None))
    assert x.std() == pytest.approx(VISCOUS * samples.qd[rows, 0].std(), rel=0.1)
    assert (y - x).var() < 0.3 * y.var()


def test_text_from_files_is_escaped():
    bad = '<script>alert(1)</script>"&\x1b[31m\n'
    for html in (markup.text(bad), markup.paragraph(bad), markup.bullets([bad]),
                 TextTable([bad, 'b'], [[bad, bad]]).html(), markup.folded(bad, ''),
                 markup.key([('red"><b>', bad)])):
        assert '<script' not in html and '\x1b' not in html and '"&' not in html
        assert '&lt;script&gt;' in html
    assert markup.units('I = 0.2 ± 0.1 kg·m^2, 3 m^3') == 'I = 0.2 ± 0.1 kg·m², 3 m³'
