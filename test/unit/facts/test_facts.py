"""Facts about recordings of an arm of two links, and about motion: faults, no false facts."""

from dataclasses import replace

from bench.shared.campaign import campaign
from bench.shared.recordings import write_folder
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.facts.fact import Action, Kind
from gravity_comp_ros.facts.motion import describe
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.cleaning import NOT_FINITE, TIME
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

NAMES = ('base', 'lower', 'upper', 'roll')
RATE, COUNT = 100.0, 4000
T = np.arange(COUNT) / RATE


def motion(centre=(0.1, -0.4, 0.6, 0.2), amplitude=0.6):
    """Return q, qd (M, 4): a sine of another period on each joint, all under 0.15 rad/s."""
    omega = np.array([0.21, 0.17, 0.23, 0.13])
    phase = omega * T[:, None] + np.array([0.0, 1.0, 2.0, 3.0])
    return centre + amplitude * np.sin(phase), amplitude * omega * np.cos(phase)


def torque(q, qd, noise=0.05, seed=0):
    """Return tau (M, 4): a vertical base, two links of 9 and 4 kg, friction, and noise."""
    both = 7.0 * np.sin(q[:, 1] + q[:, 2])
    gravity = np.column_stack([0 * both, 40.0 * np.sin(q[:, 1]) + both, both, 0 * both])
    friction = np.array([1.5, 1.2, 0.8, 0.4]) * np.tanh(qd / 0.004) + 0.5 * qd
    return gravity + friction + noise * np.random.default_rng(seed).standard_normal(q.shape)


Q, QD = motion()
TAU = torque(Q, QD)


def read(tmp_path, q=Q, qd=QD, tau=TAU, names=NAMES, t=T, **options):
    path = tmp_path / 'x.mcap'
    write_bag(path, [JointTopic('/joint_states', names, t, q, qd, tau)])
    return read_bag(path, ReadOptions(**options))


def facts(recording, kind=None):
    return [fact for fact in recording.report.facts if kind in (None, fact.kind)]


def only(recording, kind, action, joints=None):
    """Check that the recording has this fact alone; return it."""
    (fact,) = recording.report.facts
    assert (fact.kind, fact.action) == (kind, action)
    assert joints is None or fact.joints == joints
    return fact


def test_a_good_recording_has_no_facts_and_is_not_changed(tmp_path):
    recording = read(tmp_path)
    assert facts(recording) == []
    np.testing.assert_array_equal(recording.samples.tau, TAU)
    np.testing.assert_array_equal(recording.samples.qd, QD)


def test_spikes_of_the_effort_are_left_out(tmp_path):
    tau, rng = TAU.copy(), np.random.default_rng(1)
    rows = rng.choice(COUNT, 40, replace=False)
    tau[rows, 1] = 900.0 * rng.choice([-1, 1], 40)
    recording = read(tmp_path, tau=tau)
    fact = only(recording, Kind.SPIKES, Action.LEFT_OUT, ('lower',))
    assert fact.values == {'lower': 40.0} and recording.report.dropped == {'effort_spikes': 40}
    np.testing.assert_array_equal(recording.samples.tau, np.delete(TAU, rows, axis=0))
    accepted = read(tmp_path, tau=tau, accept=('effort_spikes',))
    only(accepted, Kind.SPIKES, Action.NOTED)
    np.testing.assert_array_equal(accepted.samples.tau, tau)


def test_glitches_of_the_position_are_left_out(tmp_path):
    q = Q.copy()
    q[[300, 1200, 2500], 0] = [0.0, 80.0, -2.0]
    q[1700:1702, 2] = 9.9
    recording = read(tmp_path, q=q)
    fact = only(recording, Kind.GLITCHES, Action.LEFT_OUT, ('base', 'upper'))
    assert fact.values == {'base': 3.0, 'upper': 2.0}
    assert np.abs(recording.samples.q - np.delete(Q, [300, 1200, 1700, 1701, 2500], 0)).max() == 0


@pytest.mark.parametrize('measured', [True, False])
def test_wraps_are_undone(tmp_path, measured):
    q, qd = motion(centre=(3.0, -0.4, 0.6, -2.9))
    wrapped = (q + np.pi) % (2 * np.pi) - np.pi
    recording = read(tmp_path, wrapped, qd if measured else None, torque(q, qd))
    (fact,) = facts(recording, Kind.WRAPS)
    assert fact.joints == ('base', 'roll') and fact.action is Action.CORRECTED
    turns = (q - recording.samples.q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.tile(np.rint(turns[0]), (COUNT, 1)), atol=1e-12)
    np.testing.assert_allclose(recording.samples.qd, qd, atol=5e-3)
    accepted = read(tmp_path, wrapped, qd, accept=('wrapped_positions', 'position_glitches'))
    np.testing.assert_array_equal(accepted.samples.q, wrapped)


def test_efforts_before_the_drives_are_enabled_are_left_out(tmp_path):
    tau = TAU.copy()
    tau[:700] = 0.0
    recording = read(tmp_path, tau=tau)
    assert '0 to 6.99 s' in only(recording, Kind.DISABLED, Action.LEFT_OUT).evidence
    np.testing.assert_array_equal(recording.samples.tau, TAU[700:])
    assert recording.samples.t[0] == 0.0 and recording.samples.starts[0] == pytest.approx(
        read(tmp_path).samples.starts[0] + 7.0)


@pytest.mark.parametrize(('low', 'high'), [(-22.0, 100.0), (-100.0, 8.0), (-20.0, 8.0)])
def test_clipped_efforts_are_left_out(tmp_path, low, high):
    tau = TAU.copy()
    tau[:, 1] = np.clip(tau[:, 1], low, high)
    recording = read(tmp_path, tau=tau)
    fact = only(recording, Kind.SATURATED, Action.LEFT_OUT, ('lower',))
    inside = (TAU[:, 1] > low) & (TAU[:, 1] < high)
    assert fact.values['lower'] == pytest.approx(1 - inside.mean())
    np.testing.assert_array_equal(recording.samples.tau, TAU[inside])


def test_frozen_values_are_left_out(tmp_path):
    tau, q = TAU.copy(), Q.copy()
    tau[1000:1400, 2] = tau[1000, 2]
    recording = read(tmp_path, tau=tau)
    only(recording, Kind.FROZEN, Action.LEFT_OUT, ('upper',))
    assert len(recording.samples) == COUNT - 400
    q[2000:2500, 1] = q[2000, 1]
    results = facts(read(tmp_path, q=q), Kind.FROZEN)
    assert [fact.joints for fact in results] == [('lower',)]


def test_a_recording_of_which_faults_leave_few_samples_or_none(tmp_path):
    tau = TAU.copy()
    tau[:2050, 1], tau[1950:, 2] = np.median(tau[2050:, 1]), np.median(tau[:1950, 2])
    with pytest.raises(BagError, match='lower, upper stays exactly the same .* no sample is left'):
        read(tmp_path, tau=tau)
    assert len(read(tmp_path, tau=tau, refuse=False).samples) == COUNT
    tau[:-2] = 0.0
    assert len(read(tmp_path, tau=tau).samples) == 2


@pytest.mark.parametrize('size', [0.0, 1e-309, 1e-9])
def test_dead_efforts_are_refused(tmp_path, size):
    with pytest.raises(BagError, match='effort is 0 throughout, for every joint'):
        read(tmp_path, tau=size * TAU)
    recording = read(tmp_path, tau=size * TAU, refuse=False)
    assert facts(recording, Kind.DEAD_EFFORT)[0].action is Action.REFUSED


def test_dead_efforts_of_some_joints_are_one_sentence_with_the_option(tmp_path):
    fact = only(read(tmp_path, tau=TAU * [1, 1, 0, 0]), Kind.DEAD_EFFORT, Action.NOTED, NAMES[2:])
    assert fact.sentence.startswith(f'effort of {", ".join(NAMES[2:])} is always 0: no torque')
    assert f'--joints {",".join(NAMES[:2])} leaves' in fact.sentence


def test_a_refusal_names_the_gripper_that_was_left_out(tmp_path):
    with pytest.raises(BagError, match='effort is 0 throughout.*left_finger.*left out'):
        read(tmp_path, np.c_[Q[:, 0], Q], np.c_[QD[:, 0], QD], np.zeros((COUNT, 5)),
             ('left_finger', *NAMES))


def test_efforts_that_cannot_be_torques_are_refused(tmp_path):
    with pytest.raises(BagError, match='no effort reaches 0.1 N·m .*--effort-scale'):
        read(tmp_path, tau=TAU / 5000)
    scale = dict.fromkeys(NAMES, 5000.0)
    assert facts(read(tmp_path, tau=TAU / 5000, effort_scale=scale)) == []
    only(read(tmp_path, tau=TAU / 5000, accept=('effort_unit',)), Kind.EFFORT_UNIT, Action.NOTED)
    with pytest.raises(BagError, match='effort reaches .* no arm has such torques'):
        read(tmp_path, tau=TAU * 1e4)


def test_whole_numbers_are_noted_unless_a_scale_is_given(tmp_path):
    counts = np.round(TAU * [20, 20, 30, 50])
    fact = only(read(tmp_path, tau=counts), Kind.EFFORT_UNIT, Action.NOTED)
    assert fact.joints == NAMES and '--effort-scale' in fact.otherwise
    scale = dict(zip(NAMES, 1 / np.array([20, 20, 30, 50])))
    assert facts(read(tmp_path, tau=counts, effort_scale=scale)) == []


@pytest.mark.parametrize('velocity', [
    np.degrees(QD), Q, -QD, 0 * QD])
def test_velocities_that_contradict_the_position_are_replaced(tmp_path, velocity):
    recording = read(tmp_path, qd=velocity)
    only(recording, Kind.VELOCITY, Action.CORRECTED, NAMES)
    np.testing.assert_allclose(recording.samples.qd, QD, atol=2e-3)
    assert recording.report.velocity == 'differentiated'


def test_a_velocity_agrees_on_both_sides_of_a_clock_that_is_set_back(tmp_path):
    shift = np.where(T < 25.0, 0, 10)[:, None]
    rows = []
    for k, t in enumerate(T):
        ns = 1_700_000_000 * 10**9 + round(1e9 * (t - shift[k, 0]))
        rows.append([ns, {'stamp_ns': ns, 'names': list(NAMES), 'position': list(Q[k]),
                          'velocity': list(QD[k]), 'effort': list(TAU[k])}])
    recording = read_bag(write_folder(tmp_path / 'bag', {'/joint_states': rows}))
    assert recording.report.dropped == {TIME: 1000} and facts(recording) == []
    np.testing.assert_array_equal(recording.samples.q, np.delete(Q, np.arange(2500, 3500), axis=0))


def test_a_filtered_and_noisy_velocity_is_kept(tmp_path):
    late = np.roll(QD, 20, axis=0) + 0.02 * np.random.default_rng(0).standard_normal(QD.shape)
    assert facts(read(tmp_path, qd=late)) == []


@pytest.mark.parametrize('name', ['panda_finger_joint1', 'leftKnuckleJoint'])
def test_grippers_are_left_out_unless_named(tmp_path, name):
    names = (*NAMES, name)
    arrays = [np.c_[values, values[:, 0]] for values in (Q, QD, TAU)]
    recording = read(tmp_path, *arrays, names=names)
    only(recording, Kind.GRIPPER, Action.LEFT_OUT, (name,))
    assert recording.samples.names == NAMES
    for options in ({'joints': names}, {'accept': ('gripper',)}):
        assert read(tmp_path, *arrays, names=names, **options).samples.names == names


def test_a_gripper_in_messages_of_its_own_is_left_out(tmp_path):
    rows = []
    for k in range(200):
        for names, count in ((list(NAMES), 4), (['finger_1', 'finger_2'], 2)):
            ns = 1_700_000_000 * 10**9 + 10**7 * (2 * k + (count == 2))
            values = {'position': [0.1 + 0.001 * k] * count, 'velocity': [0.05] * count}
            rows.append([ns, {'stamp_ns': ns, 'names': names, **values,
                              'effort': [1.0 + k] * count}])
    recording = read_bag(write_folder(tmp_path / 'bag', {'/joint_states': rows}))
    assert recording.samples.names == NAMES and facts(recording, Kind.GRIPPER)


def test_a_linear_joint_is_left_out(tmp_path):
    mm = 400 + 300 * np.sin(0.1 * T)
    arrays = (np.c_[mm, Q], np.c_[0 * mm, QD], np.c_[0 * mm + 3.0, TAU])
    for name in ('carriage', 'rail_joint', 'torso_lift_joint'):
        recording = read(tmp_path, *arrays, names=(name, *NAMES))
        only(recording, Kind.LINEAR_JOINT, Action.LEFT_OUT, (name,))
        assert recording.samples.names == NAMES
    assert facts(read(tmp_path, names=('shoulder_pan', 'shoulder_lift', 'elbow', 'wrist'))) == []


@pytest.mark.parametrize(('unit', 'factor'), [('deg', 180 / np.pi), ('ticks=4096', 2048 / np.pi)])
def test_other_units_of_position_are_refused_with_the_option(tmp_path, unit, factor):
    q, qd = factor * Q, factor * QD
    if unit != 'deg':
        q = np.round(q)
    with pytest.raises(BagError, match=f'--position-unit {unit}'):
        read(tmp_path, q, qd)
    recording = read(tmp_path, q, qd, position_unit=unit)
    assert facts(recording) == []
    np.testing.assert_allclose(recording.samples.q, Q, atol=1e-3)


@pytest.mark.parametrize('seed', [0, *campaign(1, 2, 3)])
def test_a_reversed_sign_is_refused(tmp_path, seed):
    tau = torque(Q, QD, seed=seed)
    with pytest.raises(BagError, match='opposite to friction.*base=-1,lower=-1.* times any scale'):
        read(tmp_path, tau=-tau)
    only(read(tmp_path, tau=-tau, accept=('effort_sign',)), Kind.EFFORT_SIGN, Action.NOTED)
    assert facts(read(tmp_path, tau=-tau, effort_scale=dict.fromkeys(NAMES, -1.0))) == []


def test_of_joints_with_the_right_friction_no_sign_is_reversed(tmp_path):
    tau = torque(Q, QD) * [1, 1, -1, -1]
    with pytest.raises(BagError, match='opposite to friction.*--effort-scale upper=-1,roll=-1 '):
        read(tmp_path, tau=tau)
    accepted = read(tmp_path, tau=tau, accept=('effort_sign',))
    only(accepted, Kind.EFFORT_SIGN, Action.NOTED, ('upper', 'roll'))


def test_compensated_gravity_is_noted_only_where_gravity_acts(tmp_path):
    friction = TAU - torque(Q, 0 * QD, 0.0)
    only(read(tmp_path, tau=friction), Kind.COMPENSATED, Action.NOTED)
    # A vertical axis alone carries no gravity, however it moves.
    q, qd = np.tile(Q[:1], (COUNT, 1)), 0 * QD
    q[:, 0], qd[:, 0] = 3 * Q[:, 0], 3 * QD[:, 0]
    assert facts(read(tmp_path, q, qd, torque(q, qd)), Kind.COMPENSATED) == []
    # Friction of many times the gravity is no compensation.
    rough = TAU + 100 * np.tanh(QD / 0.004)
    assert facts(read(tmp_path, tau=rough), Kind.COMPENSATED) == []


def publishers(rows_of_second):
    rows = []
    for k in range(500):
        ns = 1_700_000_000 * 10**9 + 2 * 10**7 * k
        rows.append([ns, {'stamp_ns': ns, 'names': list(NAMES), 'position': list(Q[k]),
                          'velocity': list(QD[k]), 'effort': list(TAU[k])}])
        rows.append([ns + 10**6, {'stamp_ns': ns + 10**6, **rows_of_second}])
    return rows


@pytest.mark.parametrize('second', [
    {'names': list(NAMES[::-1]), 'position': [0.0] * 4},
    {'names': list(NAMES), 'position': [0.0] * 4},
    {'names': list(NAMES), 'position': [0.0] * 4, 'velocity': [0.0] * 4, 'effort': [0.0] * 4},
    {'names': list(NAMES), 'position': [1.0, 2.0, 1.0, 2.0], 'effort': [0.0] * 4},
    {'names': list(NAMES), 'position': None, 'effort': [0.0] * 4}])
def test_a_second_publisher_is_left_out(tmp_path, second):
    rows = publishers(second)
    for driver, other in zip(rows[::2], rows[1::2]):
        # A mirror repeats the positions of the driver.
        other[1]['position'] = second['position'] or driver[1]['position']
    path = write_folder(tmp_path / 'bag', {'/joint_states': rows})
    recording = read_bag(path)
    only(recording, Kind.PUBLISHER, Action.LEFT_OUT)
    np.testing.assert_array_equal(recording.samples.q, Q[:500])
    assert recording.report.dropped == {'second_publisher': 500}


@pytest.mark.parametrize('every', [2, 5])
def test_messages_of_the_driver_without_effort_are_no_second_publisher(tmp_path, every):
    rows = publishers({'names': list(NAMES), 'position': [0.0] * 4})[::2]
    for _, content in rows[1::every]:
        del content['effort']
    recording = read_bag(write_folder(tmp_path / 'bag', {'/joint_states': rows}))
    assert facts(recording, Kind.PUBLISHER) == []
    assert recording.report.dropped == {NOT_FINITE: 500 // every}


ARM = arms.iiwa7()
NOISE = SynthesisOptions(noise=NoiseOptions(absolute=0.1))


def remarks(samples, word, **options):
    return [text for text in describe(samples, **options).remarks if word in text]


@pytest.mark.parametrize(('q', 'count'), [
    ([0, 1, 2, 3], 0), ([0, 1, 0], 1), ([0, 1, 0.5, 2], 2), ([0, -1, 0, -1, 0], 3),
    ([0, 0, 0], 0), ([0, 0.005, 0, 0.005, 0], 0), ([0, 1, 0.995, 1, 2], 0), ([5], 0)])
def test_reversals_by_hand(q, count):
    q = np.array(q, dtype=float)[:, None]
    samples = JointSamples.single_run('a', np.arange(len(q)), q, q + 1.0, q)
    assert describe(samples).joints['a'].reversals == count


def test_facts_by_hand():
    t = np.arange(5.0)
    q = np.array([[0, 1.0], [1, 1.0], [2, 1.0], [1, 1.0], [0, 1.0]])
    qd = np.array([[1, 0.0], [1, 0.0], [0, 0.0], [-1, 0.0], [-2, 0.0]])
    tau = np.array([[1, 3.0], [2, 3.0], [3, 3.0], [2, 3.0], [7, 3.0]])
    facts = describe(JointSamples.single_run('ab', t, q, qd, tau), GateOptions(max_speed=1.5))
    a, b = facts.joints['a'], facts.joints['b']
    assert (a.q_min, a.q_max, a.travel, a.max_speed, a.reversals) == (0, 2, 2, 2, 1)
    assert a.rms_speed == pytest.approx(np.sqrt(7 / 5))
    assert (a.tau_min, a.tau_max) == (1, 7)
    assert (b.travel, b.reversals, b.tau_std) == (0, 0, 0)
    assert facts.slow_share == pytest.approx(0.8) and facts.kept == 4
    assert any('never moves: b' in text for text in facts.remarks)


def test_poses_at_rest():
    poses = synthesise(ARM, motions.random_poses(ARM.lower, ARM.upper, 300), NOISE)
    facts = describe(poses)
    assert facts.at_rest and facts.slow_share == 1 and facts.kept == 300
    assert all(joint.reversals is None for joint in facts.joints.values())
    assert len(facts.remarks) == 1 and 'poses at rest' in facts.remarks[0]


def test_short_one_way_and_narrow():
    short = synthesise(ARM, motions.eq17(duration=4, start=2.0), NOISE)
    facts = describe(short)
    assert any('keeps 20 of 20 samples' in text for text in facts.remarks)
    one_way = remarks(short, 'one direction only')[0]
    for name, joint in facts.joints.items():
        assert (name in one_way) == (joint.travel >= 0.01 and joint.reversals == 0)
    assert 'iiwa_joint_4' in one_way
    assert 'iiwa_joint_7' in remarks(short, 'moves little')[0]


def test_reversals_between_runs_do_not_count():
    up = synthesise(ARM, motions.eq17(duration=4, start=2.0), NOISE)
    down = replace(up, q=-up.q, qd=-up.qd)
    assert describe(concatenate([up, down])).joints['iiwa_joint_4'].reversals == 0
