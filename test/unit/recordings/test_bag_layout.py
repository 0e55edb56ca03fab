"""Vectorised decoding of messages, against decoding each one alone."""

from gravity_comp_ros.recordings.joint_state_cdr import encode
from gravity_comp_ros.recordings.message_layout import _Layout, LayoutDecoder
from gravity_comp_ros.recordings.messages import Batch, batched
from hypothesis import given, strategies as st
import numpy as np

SENDERS = (
    {'names': ['a', 'bb', 'ccc']},
    {'names': ['ccc', 'bb', 'a']},
    {'names': ['a', 'bb', 'ccc'], 'frame_id': 'base'},
    {'names': ['a', 'bb', 'ccc'], 'frame_id': 'tool'},
    {'names': ['a', 'bb', 'ccd']},
    {'names': ['a', 'bb', 'ccc'], 'velocity': ()},
    {'names': ['a', 'bb', 'ccc'], 'effort': (), 'velocity': ()},
    {'names': ['a', 'bb', 'ccc'], 'position': ()},
    {'names': ['grip']},
    {'names': []},
    {'names': ['größe', '']},
)


@st.composite
def traffic(draw):
    """Draw messages of several senders, some of them truncated, damaged or too long."""
    rng = np.random.default_rng(draw(st.integers(0, 10 ** 6)))
    senders = draw(st.lists(st.sampled_from(SENDERS), min_size=1, max_size=4))
    spoilt = draw(st.sampled_from([0.0, 0.1, 0.5]))
    messages = []
    for number in range(draw(st.integers(1, 60))):
        sender = senders[rng.integers(len(senders))]
        count = len(sender['names'])
        fields = {kind: rng.normal(size=count) for kind in ('position', 'velocity', 'effort')}
        stamp = int(rng.integers(0, 2 ** 31)) * 10 ** 9 + int(rng.integers(10 ** 9))
        raw = bytearray(encode(stamp, **{**fields, **sender}))
        if rng.random() < spoilt:
            kind = rng.integers(4)
            if kind == 0:
                raw = raw[:rng.integers(len(raw))]
            elif kind == 1:
                raw[rng.integers(len(raw))] ^= int(rng.integers(1, 256))
            elif kind == 2:
                raw += bytes(int(rng.integers(1, 9)))
            else:
                raw[1] ^= 1                    # wrong byte order
        messages.append((number, bytes(raw)))
    return messages


def decode_batches(decoder, batches):
    decoded = {}
    for batch in batches:
        for block in decoder.decode(batch):
            for row, which in enumerate(block.which):
                number = int(batch.log_ns[which])
                assert number not in decoded
                decoded[number] = (block.names, int(block.stamp_ns[row]),
                                   block.position[row], block.velocity[row], block.effort[row])
    return decoded


def split(messages, rng):
    """Return the messages in several batches, with other bytes between some of them."""
    batches, begin = [], 0
    while begin < len(messages):
        part = messages[begin:begin + int(rng.integers(1, 40))]
        begin += len(part)
        gaps = [bytes(int(rng.integers(0, 3) * rng.integers(0, 9))) for _ in part]
        data = b''.join(gap + raw for gap, (_, raw) in zip(gaps, part))
        ends = np.cumsum([len(gap) + len(raw) for gap, (_, raw) in zip(gaps, part)])
        length = np.array([len(raw) for _, raw in part])
        batches.append(Batch(np.frombuffer(data, dtype=np.uint8), ends - length, length,
                             np.array([number for number, _ in part], dtype=np.uint64)))
    return batches


@given(traffic(), st.integers(0, 10 ** 6))
def test_a_batch_is_decoded_as_its_messages_are_alone(messages, seed):
    alone = {}
    for message in messages:
        alone |= decode_batches(LayoutDecoder(), batched(iter([message])))
    decoded = decode_batches(LayoutDecoder(), split(messages, np.random.default_rng(seed)))
    assert decoded.keys() == alone.keys()
    for number, (names, stamp, *values) in alone.items():
        assert decoded[number][:2] == (names, stamp)
        for value, single in zip(decoded[number][2:], values):
            assert value.dtype == np.float64
            np.testing.assert_array_equal(value, single)


def test_a_repeated_layout_is_parsed_once(monkeypatch):
    names = [f'joint{k}' for k in range(7)]
    values = np.random.default_rng(0).normal(size=(500, 3, 7))
    messages = [(k, encode(k * 10 ** 6, names, *rows)) for k, rows in enumerate(values)]
    calls = []
    parse = _Layout.__init__
    monkeypatch.setattr(_Layout, '__init__',
                        lambda self, *args: calls.append(1) or parse(self, *args))
    decoder = LayoutDecoder()
    for _ in range(2):
        blocks = list(decoder.decode(next(batched(iter(messages)))))
        order = np.concatenate([block.which for block in blocks])
        np.testing.assert_array_equal(np.sort(order), np.arange(500))
        effort = np.concatenate([block.effort for block in blocks])[np.argsort(order)]
        np.testing.assert_array_equal(effort, values[:, 2])
    assert len(calls) == 1


def test_more_layouts_than_are_kept():
    messages = [(k, encode(k, [f'j{k % 40}'], [1.0 * k])) for k in range(200)]
    decoded = decode_batches(LayoutDecoder(), batched(iter(messages)))
    assert [decoded[k][0] for k in range(200)] == [(f'j{k % 40}',) for k in range(200)]
    assert [decoded[k][2][0] for k in range(200)] == list(range(200))
