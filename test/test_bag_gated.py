"""Streaming reader with gate: same samples, notes and errors as reading, then gating."""

from dataclasses import replace

from gravity_comp_ros.data.gate import BlockGate, GateOptions, slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.gated_bag import read_gated
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from recordings import messages, NAMES, write_folder

GATES = (GateOptions(max_speed=0.9), GateOptions(max_speed=(0.5, 2.0, 2.0), rate_hz=None),
         GateOptions(max_speed=2.0, max_acceleration=0.8, rate_hz=20.0),
         GateOptions(max_speed=1e-6))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10 ** 6), st.lists(st.integers(0, 40), max_size=6),
       st.sampled_from(GATES[:3]))
def test_blocks_of_any_size_are_gated_equally(seed, sizes, options):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.choice([0.01, 0.02, 0.3], 100))
    qd = np.cumsum(0.1 * rng.normal(size=(100, 3)), axis=0)
    whole = slow_samples(JointSamples.single_run(NAMES, t, qd, qd, qd), options)
    gate, kept, begin = BlockGate(3, options), [], 0
    for size in [*sizes, 100]:
        block = slice(begin, min(begin + size, 100))
        kept.append(t[block][gate.offer(t[block], qd[block])])
        begin = block.stop
    np.testing.assert_array_equal(np.concatenate(kept), whole.samples.t)
    assert dict(gate.dropped) == whole.dropped


def rare(change, every=9):
    """Return 200 messages, of which every `every`-th is changed."""
    rows = messages(200)
    for row in rows[every::every]:
        change(row)
    return rows


def nothing(row):
    pass


def other_order(row):
    fields = row[1]
    for name in ('names', 'position', 'velocity', 'effort'):
        fields[name] = fields[name][::-1]


def broken(row):
    row[1] = b'\0\1\0\0none'


def repeat_stamp(row):
    row[1]['stamp_ns'] -= 40_000_000


def nan(row):
    row[1]['effort'][1] = np.nan


def one_short(row):
    row[1]['position'] = row[1]['position'][:2]


def gripper(row):
    row[1].update(names=['grip'], position=[0.1], velocity=[0.0], effort=[1.0])


def long_frame(row):
    row[1]['frame_id'] = 'base_link'


def without_elbow(row):
    for name in ('names', 'position', 'velocity', 'effort'):
        row[1][name] = row[1][name][::2]


def no_velocity(row):
    row[1]['velocity'] = []


def no_stamp(row):
    row[1]['stamp_ns'] = 0


def rest(row):
    row[1]['velocity'] = [0.0] * 3


def weightless(row):
    row[1]['effort'][0] = 0.0


CHANGES = (nothing, other_order, broken, repeat_stamp, nan, one_short, gripper, long_frame,
           without_elbow, no_velocity, no_stamp, rest, weightless)
OPTIONS = (ReadOptions(), ReadOptions(joints=('wrist', 'shoulder')),
           ReadOptions(effort_scale={'elbow': -2.0}), ReadOptions(differentiate=True),
           ReadOptions(effort_scale={'hip': 2.0}), ReadOptions(joints=('hip',)))


@pytest.mark.parametrize('every', [1, 9])
@pytest.mark.parametrize('change', CHANGES)
def test_gated_reading_equals_reading_then_gating(tmp_path, change, every):
    rows = rare(change, every)
    path = write_folder(tmp_path / 'bag', {'/joint_states': rows}, plugin='mcap')
    for number, options in enumerate(OPTIONS):
        gate = GATES[0] if options.joints else GATES[number % 3]
        check_same(path, options, gate)


def check_same(path, options, gate):
    try:
        whole = read_bag(path, options)
        slow = slow_samples(whole.samples, gate)
    except GravityCompError as error:
        with pytest.raises(type(error)) as again:
            read_gated(path, options, gate)
        assert str(again.value) == str(error)
        return
    result = read_gated(path, options, gate)
    assert result.samples.names == slow.samples.names
    for field in ('t', 'q', 'qd', 'tau'):
        np.testing.assert_array_equal(getattr(result.samples, field),
                                      getattr(slow.samples, field))
    assert result.report == whole.report
    assert result.dropped == slow.dropped


def test_a_gate_for_other_joints_is_refused(tmp_path):
    path = write_folder(tmp_path / 'bag', {'/joint_states': messages(20)}, plugin='mcap')
    with pytest.raises(GravityCompError, match='2 values for 3 joints'):
        read_gated(path, gate=replace(GATES[0], max_speed=(1.0, 1.0)))
