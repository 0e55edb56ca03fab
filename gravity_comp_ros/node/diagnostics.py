"""Diagnostics of the node without ROS types: one `Status` per component."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.feedforward import FADED, FADING, HOLDING
from gravity_comp_ros.node.messages import FAULTS, FROM_FUTURE, HANDLED, REPLACED, TOO_OLD

OK, WARN, ERROR, STALE = range(4)

# Share of the messages that newer ones replaced from which there is a warning.
MAX_LATE = 0.1

# Ratio of residual to training residual from which another payload is suspected.
CHANGED = 5.0


NO_LIMITS = 'no torque is published without limits: set max_torque, or unlimited_torque'


@dataclass(frozen=True)
class Status:
    """Level, message and values of a `diagnostic_msgs/DiagnosticStatus`."""

    name: str
    level: int
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def input_status(topic: str, received: int, new: int, age: float | None, stale: bool,
                 counts: Mapping[str, int], fresh: Mapping[str, int], late: int = 0,
                 stamp_age: float = 0.0) -> Status:
    """
    Return the state of the input.

    :param received: messages since the start; `new` of them since the last report.
    :param age: time since the last usable message in s, None before the first.
    :param counts: drops by reason since the start; `fresh` of them since the last report.
    :param late: messages since the last report that a newer one replaced before it was answered.
    :param stamp_age: difference of the last stamp from the clock, s.
    """
    values = {'topic': topic, 'messages': str(received), 'messages since last report': str(new),
              'age of last usable message [s]': 'none' if age is None else f'{age:.3f}'}
    if late:
        values['messages replaced by newer ones'] = str(late)
    for reason in (*FAULTS, *REPLACED, *HANDLED):
        if counts.get(reason):
            values[f'count {reason}'] = str(counts[reason])
    named = ', '.join(f'{reason} {fresh[reason]}' for reason in FAULTS if fresh.get(reason))
    if fresh.get(TOO_OLD) or fresh.get(FROM_FUTURE):
        named += (f' (the last stamp is {abs(stamp_age):.3g} s '
                  f'{"old" if stamp_age > 0.0 else "in the future"}: synchronise the clocks, or '
                  'raise max_age)')
    replaced = ', '.join(f'{reason} {fresh[reason]}' for reason in REPLACED if fresh.get(reason))
    if age is None and new == 0:
        level, message = STALE, f'no message on {topic}' + ('' if not received else ' now')
    elif stale:
        level = STALE if new == 0 else ERROR
        message = f'input is stale: no usable message for {age or 0.0:.1f} s'
        message += f' ({named})' if named else ''
    elif named:
        level = ERROR if age is None else WARN
        message = f'dropped: {named}'
    elif replaced:
        level, message = WARN, f'replaced by other data: {replaced}'
    elif late > MAX_LATE * new:
        level, message = WARN, ('messages arrive faster than they are answered, and newer ones '
                                'replace others: raise the priority of this process, or lower the '
                                'rate')
    elif age is None:
        level, message = WARN, f'none of the joints of this arm in the messages on {topic}'
    else:
        level, message = OK, f'{new} messages'
    return Status('input', level, message, values)


def model_status(described: str | None, age: float, n_past: int, problem: str) -> Status:
    """Return the state of the model; `problem` is the error of loading or saving its file."""
    values = {'earlier models': str(n_past)}
    if described is None:
        return Status('model', ERROR if problem else WARN, problem or
                      'no model yet: no torque is published', values)
    values['age [s]'] = f'{age:.1f}'
    return Status('model', WARN if problem else OK, problem or described, values)


@dataclass(frozen=True)
class Learning:
    """State of the epoch, the fit process and the last fit, for `learning_status`."""

    epoch: str
    n_samples: int
    n_held_out: int
    lacking: tuple[str, ...]
    gate: Mapping[str, int]
    process: str
    restarts: int
    pid: int | None
    failure: str
    last_fit: str
    kept_old: bool
    compensated: bool
    broken: bool = False
    outliers: str = ''
    checks: tuple[Check, ...] = ()


def learning_status(learning: Learning) -> Status:
    """Return the state of data collection and fits."""
    values = {'epoch': learning.epoch, 'samples': str(learning.n_samples),
              'held out': str(learning.n_held_out),
              'lacking range': ', '.join(learning.lacking) or 'none',
              'fit process': learning.process, 'fit process id': str(learning.pid or ''),
              'fit process restarts': str(learning.restarts), 'last fit': learning.last_fit}
    for reason, count in learning.gate.items():
        values[f'gate {reason}'] = str(count)
    for check in learning.checks:
        values[f'check {check.name}'] = check.describe()
    if learning.failure:
        level, problem = ERROR, f'{learning.failure}; the old model stays in use'
    elif learning.broken:
        level, problem = ERROR, f'broken effort: {learning.last_fit}'
    elif learning.compensated:
        level, problem = WARN, learning.last_fit
    elif learning.kept_old:
        level, problem = WARN, f'old model kept: {learning.last_fit}'
    elif learning.outliers:
        level, problem = WARN, (f'samples left out as outliers: {learning.outliers} (an '
                                'intermittent brake, or a contact with the arm)')
    else:
        return Status('learning', OK, learning.epoch, values)
    return Status('learning', level, f'{problem}; {learning.epoch}', values)


def feedforward_status(state: str, enabled: bool, outside: float, limits: str,
                       margin: float, sent: tuple[str, ...] = (), problem: str = '') -> Status:
    """
    Return the state of the published torque.

    :param outside: distance of the pose outside the trained range in rad; `margin` likewise.
    :param limits: source of the torque limits; with `none` no torque is published.
    :param sent: the effects that are compensated; `problem` is why one is not.
    """
    values = {'enabled': str(enabled).lower(), 'outside trained range [rad]': f'{outside:.3f}',
              'torque limits': limits,
              'compensated effects': ', '.join(sent) or 'none'}
    if limits == 'none':
        return Status('feed-forward', ERROR, NO_LIMITS, values)
    if state in (HOLDING, FADING, FADED):
        return Status('feed-forward', ERROR, state, values)
    if outside > margin:
        problem = f'the pose is {outside:.2f} rad outside the trained range'
    elif not problem and limits == 'unlimited':
        problem = 'no torque limits: set max_torque'
    if problem:
        return Status('feed-forward', WARN, f'{state}; {problem}', values)
    return Status('feed-forward', OK, state, values)


def payload_status(suspected: str, other: str) -> Status:
    """
    Return whether the payload of the arm is that of the model.

    :param suspected: evidence of another payload; empty if none is suspected.
    :param other: evidence of a change of the effort that no payload explains; empty if none.
    """
    if suspected:
        return Status('payload', WARN, suspected)
    return Status('payload', WARN if other else OK, other or 'no other payload is suspected')


def joint_statuses(joints: tuple[str, ...], span: FloatArray, residual: FloatArray | None,
                   noise: FloatArray | None, outside: FloatArray | None,
                   is_closed: bool) -> list[Status]:
    """
    Return one status per joint.

    :param span: range of motion in this epoch (N,), rad.
    :param residual: RMS over the slow samples since the last report (2, N), N·m, of measured
        minus predicted torque, with and without nuisance terms; None without samples.
    :param noise: residual of the training, and expected residual without nuisance terms (2, N),
        N·m; None without a model.
    :param outside: distance outside the trained range (N,), rad; None without a model.
    :param is_closed: whether the epoch is closed; in an open epoch a large residual is expected.
    """
    statuses = []
    for k, name in enumerate(joints):
        values = {'range in this epoch [rad]': f'{span[k]:.3f}'}
        level, message = OK, 'no model' if noise is None else 'ok'
        if noise is not None and outside is not None:
            values['training residual [Nm]'] = f'{noise[0, k]:.4f}'
            values['outside trained range [rad]'] = f'{outside[k]:.3f}'
        if residual is not None and noise is not None:
            values['residual [Nm]'] = f'{residual[0, k]:.4f}'
            values['residual beside friction [Nm]'] = f'{residual[1, k]:.4f}'
            message = f'residual {residual[0, k]:.3g} N·m'
            here = outside is None or not outside.any()
            if is_closed and here and residual[1, k] > CHANGED * noise[1, k]:
                level = WARN
                message += (f', {residual[1, k] / noise[1, k]:.0f} times that of the training: '
                            'another payload? call payload_changed')
        statuses.append(Status(f'joint {name}', level, message, values))
    return statuses
