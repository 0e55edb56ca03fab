"""One fault of each kind on a six-axis arm of 20 kg, at other sizes and rates than elsewhere."""

from pathlib import Path

from bench.cases.arms import six_axis
from bench.real_robots.laws import gear_friction, Site
from bench.shared.campaign import campaign
from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.facts.fact import Action, Kind
from gravity_comp_ros.facts.judge import judge
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.arms import gravity_torque
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = six_axis()
NAMES = ('swing', 'luff', 'bend', 'pitch', 'yaw', 'spin')
RATE = 40.0
T = np.arange(3600) / RATE
_W = 2 * np.pi / np.array([37.0, 31.0, 27.0, 41.0, 33.0, 39.0])
_PHASE = _W * T[:, None] + np.array([0.3, 1.9, 4.1, 2.2, 5.3, 0.9])
Q = np.array([0.4, -1.1, 1.0, -0.3, 0.8, 0.2]) + 0.5 * np.sin(_PHASE)
QD = 0.5 * _W * np.cos(_PHASE)
TAU = (gravity_torque(ARM, Q) + np.array([3.0, 4.0, 2.0, 0.8, 0.7, 0.4]) * np.tanh(QD / 0.003)
       + 0.08 * np.random.default_rng(5).standard_normal(Q.shape))


def read(tmp_path, q=Q, qd=QD, tau=TAU, names=NAMES, t=T, **options):
    path = tmp_path / 'x.mcap'
    write_bag(path, [JointTopic('/joint_states', names, t, q, qd, tau)])
    return read_bag(path, ReadOptions(**options))


def changed(array, rows, joint, value):
    result = array.copy()
    result[rows, joint] = value
    return result


def with_joint(name, q, tau):
    """Return the arrays with a joint before the others."""
    qd = np.gradient(q, T)
    return {'names': (name, *NAMES), 'q': np.column_stack([q, Q]),
            'qd': np.column_stack([qd, QD]), 'tau': np.column_stack([tau, TAU])}


FAULTS = {
    'a spike in the first sample': (
        {'tau': changed(TAU, 0, 1, 900.0)}, Kind.SPIKES, Action.LEFT_OUT, {'luff'}),
    'an angle of 0 before the first reading': (
        {'q': changed(Q, 0, 1, 0.0)}, Kind.GLITCHES, Action.LEFT_OUT, {'luff'}),
    'a rail in mm that has the name of an arm joint': (
        with_joint('axis0', 400 + 250 * np.sin(T / 9), 20 * np.sign(np.cos(T / 9))),
        Kind.LINEAR_JOINT, Action.LEFT_OUT, {'axis0'}),
    'glitches of one encoder turn of a motor of 1:50': (
        {'q': Q + np.isin(np.arange(3600), [410, 1733, 2900])[:, None] * [0, 0, 0, 0.126, 0, 0]},
        Kind.GLITCHES, Action.LEFT_OUT, {'pitch'}),
    'drive disabled in the middle': (
        {'tau': np.where(((T > 41) & (T < 47))[:, None], 0.0, TAU)},
        Kind.DISABLED, Action.LEFT_OUT, set()),
    'velocity in rpm': ({'qd': QD * [1, 1, 1, 1, 9.549, 1]},
                        Kind.VELOCITY, Action.CORRECTED, {'yaw'}),
    'wraps at 0 and 2 pi': ({'q': np.mod(Q, 2 * np.pi)}, Kind.WRAPS, Action.CORRECTED, None),
    'gripper first, in mm': (
        with_joint('finger_joint', 20 + 20 * np.sign(np.sin(T / 3)), 15 * np.sign(np.cos(T / 3))),
        Kind.GRIPPER, Action.LEFT_OUT, {'finger_joint'}),
    'one sensor is off': ({'tau': changed(TAU, slice(None), 4, 0.0)},
                          Kind.DEAD_EFFORT, Action.NOTED, {'yaw'}),
    'efforts of three joints in a cycle': (
        {'tau': TAU[:, [0, 3, 1, 2, 4, 5]]}, Kind.ORDER, Action.REFUSED,
        {'luff', 'bend', 'pitch'}),
    'stuck encoder for 8 s': (
        {'q': changed(Q, slice(1200, 1520), 1, Q[1200, 1])},
        Kind.FROZEN, Action.LEFT_OUT, {'luff'}),
}


def test_without_a_fault_there_is_no_fact(tmp_path):
    assert read(tmp_path).report.facts == ()


@pytest.mark.parametrize('name', FAULTS)
def test_a_fault_is_found_and_nothing_else(tmp_path, name):
    arrays, kind, action, joints = FAULTS[name]
    facts = read(tmp_path, refuse=False, **arrays).report.facts
    assert [(fact.kind, fact.action) for fact in facts] == [(kind, action)]
    assert joints is None or set(facts[0].joints) == joints


def test_a_joint_in_degrees_among_others_is_refused(tmp_path):
    degrees = np.array([1, 1, 57.3, 1, 1, 1])
    with pytest.raises(BagError, match='bend .* is it in degrees. .--position-unit bend=deg'):
        read(tmp_path, q=Q * degrees, qd=QD * degrees)
    assert read(tmp_path, q=Q * degrees, qd=QD * degrees,
                position_unit={'bend': 'deg'}).report.facts == ()


def test_a_stuck_encoder_without_velocities(tmp_path):
    held = changed(Q, slice(1200, 1520), 1, Q[1200, 1])
    fact, velocity = read(tmp_path, q=held, qd=None).report.facts
    assert (fact.kind, fact.joints, velocity.kind) == (Kind.FROZEN, ('luff',), Kind.VELOCITY)
    # Poses that are held, with the moves between them.
    part = np.clip((T % 12.0 - 4.0) / 8.0, 0.0, 1.0)
    poses = np.random.default_rng(2).uniform(-1.0, 1.0, (9, 6))
    k = (T // 12.0).astype(int)
    q = poses[k] + part[:, None] * (poses[k + 1] - poses[k])
    assert [fact.kind for fact in read(tmp_path, q=q, qd=None).report.facts] == [Kind.VELOCITY]


@pytest.mark.parametrize('constant', [0.3, 0.6])
def test_the_filter_of_a_driver_is_undone(tmp_path, constant):
    late = TAU.copy()
    for k in range(1, len(late)):
        late[k] = late[k - 1] + (TAU[k] - late[k - 1]) * (1 - np.exp(-1 / (RATE * constant)))
    recording = read(tmp_path, tau=late)
    (fact,) = recording.report.facts
    assert (fact.kind, fact.action) == (Kind.LAG, Action.CORRECTED)
    estimated = float(fact.evidence.split(' of ')[-1].split()[0])
    assert estimated == pytest.approx(constant, rel=0.15)
    assert (recording.samples.tau - TAU).std() < 0.3 * (late - TAU).std()
    assert (read(tmp_path, tau=late, accept=('effort_lag',)).samples.tau == late).all()


def test_friction_that_builds_up_over_an_angle_is_no_filter(tmp_path):
    for angle in (0.01, 0.03):
        built_up = np.zeros_like(Q)
        for k in range(1, len(Q)):
            way = 1 - np.exp(-np.abs(Q[k] - Q[k - 1]) / angle)
            built_up[k] = built_up[k - 1] + way * (np.sign(QD[k]) - built_up[k - 1])
        tau = gravity_torque(ARM, Q) + np.array([3.0, 4.0, 2.0, 0.8, 0.7, 0.4]) * built_up
        noise = 0.08 * np.random.default_rng(5).standard_normal(Q.shape)
        assert read(tmp_path, tau=tau + noise).report.facts == ()


def test_friction_of_bristles_is_no_filter(tmp_path):
    """LuGre friction with a Stribeck dip, which builds up over 0.1 to 1 mrad."""
    rng, scale = np.random.default_rng(4), np.abs(TAU).max(axis=0)
    motion = multisine(Q.min(axis=0), Q.max(axis=0), ARM.max_speed, 7,
                       MultisineOptions(0.15, 90.0, 0.07, 4), 90.0, RATE)
    laws = [gear_friction(Site(j, float(scale[j]), -1.0, 1.0, -3.0, 3.0), rng) for j in range(6)]
    exact = synthesise(ARM, motion, SynthesisOptions(disturbances=tuple(laws)))
    tau = exact.tau + 1e-3 * scale * rng.standard_normal(exact.tau.shape)
    assert read(tmp_path, exact.q, exact.qd, tau, t=exact.t).report.facts == ()


BAGS = sorted((Path(__file__).resolve().parents[3] / 'bags').glob('*.mcap'))
IIWA = arms.iiwa7()
FRICTION = np.array([4.0, 4.0, 3.0, 3.0, 1.0, 1.0, 0.5])


@pytest.mark.parametrize('path', BAGS, ids=lambda path: path.stem)
def test_sample_recordings(path):
    # Poses without noise: two joints carry no torque, and there is no velocity.
    expected = {Kind.DEAD_EFFORT, Kind.VELOCITY} if path.stem in (
        'eq15_test', 'random_poses') else set()
    recording = read_bag(path)
    assert {fact.kind for fact in recording.report.facts} == expected
    assert not recording.report.dropped


def facts(samples, tau, qd=None):
    none = np.zeros(samples.n_joints, dtype=bool)
    signals = Signals(samples.names, samples.t, samples.q, samples.qd if qd is None else qd, tau,
                      np.arange(len(samples)))
    return {fact.kind for fact in judge(signals, np.ones(samples.n_joints), none).facts
            if fact.kind not in (Kind.DEAD_EFFORT, Kind.CONSTANT_EFFORT)}


def hysteresis(samples):
    """Return friction that builds up over 0.01 rad, by joint (M, N)."""
    out = np.zeros_like(samples.q)
    step = np.diff(samples.q, axis=0)
    for k in range(1, len(out)):
        out[k] = np.clip(out[k - 1] + step[k - 1] / 0.01, -1, 1)
    return FRICTION * out


@pytest.mark.parametrize('speed, noise, seed', [
    (0.1, 0.2, 0), (0.6, 0.0, 1), *campaign((0.1, 0.0, 0), (0.6, 0.2, 0), (0.6, 0.2, 1))])
def test_simulated_motion(speed, noise, seed):
    motion = motions.multisine(IIWA.lower, IIWA.upper, IIWA.max_speed, seed,
                               MultisineOptions(max_speed=speed), rate=20.0)
    samples = synthesise(IIWA, motion, SynthesisOptions(noise=NoiseOptions(absolute=noise)))
    rng = np.random.default_rng(seed)
    coulomb = FRICTION * np.tanh(samples.qd / 0.003)
    coarse = np.round((samples.tau + coulomb) / 0.8) * 0.8
    contact = samples.tau + coulomb
    contact[300:340] += 15.0 * np.sin(np.linspace(0, np.pi, 40))[:, None]
    ripple = samples.tau + coulomb + 0.5 * np.sin(40 * samples.q)
    drift = samples.tau + coulomb * np.exp(-samples.t / 40)[:, None]
    for tau in (samples.tau, samples.tau + coulomb, samples.tau + hysteresis(samples), coarse,
                contact, ripple, drift, samples.tau + 3.0 + 0.02 * samples.t[:, None]):
        assert facts(samples, tau) == set()
    late = np.roll(samples.qd, 2, axis=0) + 0.01 * rng.standard_normal(samples.qd.shape)
    assert facts(samples, samples.tau + coulomb, late) == set()
    assert facts(samples, samples.tau + coulomb, differentiate(samples.t, samples.q)) == set()
