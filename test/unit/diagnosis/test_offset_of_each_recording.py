"""A torque sensor that is set at each start has another offset or gain in each recording."""

from dataclasses import replace

from bench.shared.campaign import campaign
from bench.shared.rough_links import NOISE, two_links, WIDE
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import FOUND
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.estimation.update import update
import numpy as np
import pytest

MORNING = 1.7e9
# Between the starts of recordings: on a clock, and where each begins at the same time.
CLOCKS = (100.0, 0.0)


def recorded(seed: int, offset: float, start: float) -> JointSamples:
    """Return a minute of two links, of which the elbow has this offset more."""
    samples = two_links(seed, reach=WIDE)
    return replace(samples, tau=samples.tau + [0.0, offset], starts=(start,))


def offset_of(runs: list[JointSamples]):
    """Return the model with friction and offset added, and the elbow's offset in it."""
    samples = concatenate(runs)
    model = fit(samples).model
    findings = diagnose(samples, model).findings
    targets = [f'{f.effect}:{f.joint}' for f in findings if f.verdict in FOUND and f.joint]
    assert set(targets) >= {'torque_offset:elbow', 'coulomb_friction:shoulder'}
    model = refit(samples, model, requests(targets, samples.names)).model
    return model, next(e for e in model.applied.effects if e.name == 'torque_offset')


def rmse(model, samples: JointSamples) -> float:
    """Return the error of the elbow, N·m."""
    return float(np.sqrt(((predict_torque(model, samples) - samples.tau)[:, 1] ** 2).mean()))


@pytest.mark.parametrize('step', CLOCKS)
@pytest.mark.parametrize('seed', [0, *campaign(10)])
def test_the_offset_of_each_recording_is_found_and_the_mean_is_predicted_later(seed, step):
    offsets = [1.2, -0.9, 0.3]
    runs = [recorded(seed + k, offset, MORNING + step * k) for k, offset in enumerate(offsets)]
    model, offset = offset_of(runs)
    # `two_links` has an offset of 0.4 N·m itself.
    truth = {'b': 0.6, 'd_1': 1.0, 'd_2': -1.1}
    assert set(offset.coefficients) == set(truth)
    for symbol, value in truth.items():
        low, high = offset.coefficients[symbol].ci95
        assert low - 0.02 < value < high + 0.02 and high - low < 0.3
    for run in runs:
        assert rmse(model, run) < 1.2 * NOISE
    assert rmse(model, recorded(seed + 5, 0.2, MORNING + 50 * step)) < 1.2 * NOISE
    assert rmse(model, recorded(seed + 6, 1.2, MORNING + 60 * step)) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize('starts', [(MORNING, MORNING + 100.0), (0.0, 0.0)])
def test_one_offset_in_all_recordings_is_one_coefficient(starts):
    model, offset = offset_of([recorded(k, 0.5, start) for k, start in enumerate(starts)])
    assert set(offset.coefficients) == {'b'}
    low, high = offset.coefficients['b'].ci95
    assert low < 0.9 < high


def test_a_spring_at_rest_far_outside_is_no_alternative_to_an_offset():
    spring = library_effects()['joint_spring']
    linear, crank = {'centre': 0.1, 'overtones': 0.0}, {'centre': 0.1, 'overtones': 1.0}
    assert spring.implausible(np.array([0.2, 1.2]), linear) is None
    assert '360 degrees' in spring.implausible(np.array([-0.2, 1.3]), linear)
    assert spring.implausible(np.array([0.0, 1.3]), crank) is None


def test_an_offset_that_differs_between_recordings_is_no_payload_in_an_update():
    runs = [recorded(k, offset, MORNING) for k, offset in enumerate([1.2, -0.9])]
    model, later = fit(concatenate(runs)).model, recorded(7, 0.9, MORNING)
    changed = update(model, later.select(np.arange(0, later.n_samples, 4))).model
    at = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 2))
    assert np.abs(changed.predict(at) - model.predict(at)).max() < 0.15


def gains_of(gains, step=100.0):
    """Return three recordings whose efforts of the shoulder have these gains, and the findings."""
    runs = []
    for k, gain in enumerate(gains):
        samples = two_links(20 + k, reach=WIDE)
        runs.append(replace(samples, tau=samples.tau * [gain, 1.0],
                            starts=(MORNING + step * k,)))
    samples = concatenate(runs)
    model = fit(samples).model
    return samples, model, {(f.effect, f.joint): f for f in diagnose(samples, model).findings
                            if f.verdict in FOUND}


@pytest.mark.parametrize('step', CLOCKS)
def test_a_gain_of_each_recording_is_found_and_the_mean_is_predicted_later(step):
    samples, model, findings = gains_of([1.1, 0.95, 1.0], step)
    gain = findings['torque_gain', 'shoulder'].coefficients
    # The mean gain is part of gravity; the deviations are relative to it.
    assert set(gain) == {'k', 'd_1', 'd_2'}
    for symbol, true in (('d_1', 1.1 - 1.0167), ('d_2', 0.95 - 1.0167)):
        assert gain[symbol].value == pytest.approx(true, abs=0.015)
    assert not any(effect == 'payload_change' for effect, _ in findings)
    targets = [f'{effect}:{joint}' for effect, joint in findings if joint]
    model = refit(samples, model, requests(targets, samples.names)).model
    later = two_links(30, reach=WIDE)
    later = replace(later, tau=later.tau * [1.0167, 1.0], starts=(MORNING + 10 * step,))
    error = (predict_torque(model, later) - later.tau)[:, 0]
    assert np.sqrt((error ** 2).mean()) < 2.0 * NOISE
