"""Diagnostics of the node without ROS types: one `Status` per component."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.evaluation.expected_residual import expected_residual
from gravity_comp_ros.node.arm import Arm, NO_LIMITS
from gravity_comp_ros.node.checks import ERROR, OK, STALE, WARN
from gravity_comp_ros.node.feedforward import FADED, FADING, HOLDING
from gravity_comp_ros.node.learner import Learner
from gravity_comp_ros.node.messages import FAULTS
from gravity_comp_ros.node.model_history import ModelHistory
from gravity_comp_ros.node.options import CHECKS, NODE
from gravity_comp_ros.node.watch import Watch


@dataclass(frozen=True)
class Status:
    """Level, message and values of a `diagnostic_msgs/DiagnosticStatus`."""

    name: str
    level: int
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def input_status(topic: str, arm: Arm | None, now: float, late: int, unusable: int) -> Status:
    """
    Return the state of the input since the last report.

    :param arm: None while no message has named the joints of an arm.
    :param late: messages that a newer one replaced before it was answered.
    :param unusable: messages that name no arm.
    """
    if arm is None:
        values = {'topic': topic, 'messages': str(unusable)}
        if unusable:
            return Status('input', ERROR, f'dropped: missing_joint {unusable}', values)
        return Status('input', STALE, f'no message on {topic}', values)
    reader, age = arm.reader, None if arm.last_seen is None else now - arm.last_seen
    new, counts = reader.take_new()
    values = {'topic': topic, 'messages': str(reader.received),
              'messages since last report': str(new),
              'age of last usable message [s]': 'none' if age is None else f'{age:.3f}'}
    if late:
        values['messages replaced by newer ones'] = str(late)
    values |= {f'count {reason}': str(n) for reason, n in reader.counts.items()}
    named = ', '.join(f'{reason} {counts[reason]}' for reason in FAULTS if counts[reason] > 0)
    if counts['too_old'] or counts['from_future']:
        named += (f' (the last stamp is {abs(reader.age):.3g} s '
                  f'{"old" if reader.age > 0.0 else "in the future"}: synchronise the clocks, or '
                  'raise max_age)')
    if age is None and new == 0:
        level, message = STALE, f'no message on {topic}' + ('' if not reader.received else ' now')
    elif age is not None and age > arm.settings.stale_after:
        level = STALE if new == 0 else ERROR
        message = f'input is stale: no usable message for {age:.1f} s'
        message += f' ({named})' if named else ''
    elif named:
        level, message = ERROR if age is None else WARN, f'dropped: {named}'
    elif late > NODE.max_late * new:
        level, message = WARN, ('messages arrive faster than they are answered, and newer ones '
                                'replace others: raise the priority of this process, or lower the '
                                'rate')
    elif age is None:
        level, message = WARN, f'none of the joints of this arm in the messages on {topic}'
    else:
        level, message = OK, f'{new} messages'
    return Status('input', level, message, values)


def model_status(models: ModelHistory, now: float, no_arm: str) -> Status:
    """
    Return the state of the model, and of loading or saving its file.

    :param no_arm: the reason why messages name no arm, empty if there is none.
    """
    values, entry = {'earlier models': str(len(models.past))}, models.entry
    problem = models.problem or models.load_problem or no_arm
    text = 'no model yet: no torque is published'
    if entry is not None:
        values['age [s]'], text = f'{max(0.0, now - entry.since):.1f}', entry.describe()
    return Status('model', (OK if entry else WARN) + bool(problem), problem or text, values)


def learning_status(learner: Learner) -> Status:
    """Return the state of data collection and fits."""
    epoch, fits = learner.arm.epoch, learner.fits
    values = {'epoch': epoch.describe(), 'samples': str(len(epoch)),
              'held out': str(epoch.n_held_out),
              'lacking range': ', '.join(epoch.short_of_range()) or 'none',
              'fit process': 'ready' if fits.job is None else 'fitting',
              'fit process id': str(fits.pid or ''), 'last fit': learner.last_fit}
    values |= {f'gate {reason}': str(n) for reason, n in learner.arm.gate_counts.items()}
    values |= {f'check {check.name}': check.describe() for check in learner.last_checks}
    text = '; '.join(filter(None, (learner.report, epoch.describe())))
    return Status('learning', learner.level, text, values)


def feedforward_status(arm: Arm, now: float) -> Status:
    """Return the state of the published torque."""
    in_use, state = arm.in_use, arm.feed.state(now)
    effects, problem = ((), '') if in_use is None else (in_use.published, in_use.problem)
    outside = float(arm.outside.max())
    values = {'enabled': str(arm.feed.enabled).lower(),
              'outside trained range [rad]': f'{outside:.3f}', 'torque limits': arm.limit_source,
              'static effects': ', '.join(effects) or 'none'}
    level = OK
    if arm.limit_source == 'none':
        level, state = ERROR, NO_LIMITS
    elif state in (HOLDING, FADING, FADED):
        level = ERROR
    elif outside > arm.feed.margin:
        level, state = WARN, f'{state}; the pose is {outside:.2f} rad outside the trained range'
    elif problem or arm.limit_source == 'unlimited':
        level, state = WARN, f'{state}; {problem or "no torque limits: set max_torque"}'
    return Status('feed-forward', level, state, values)


def payload_status(watch: Watch) -> Status:
    """Return whether the payload of the arm is that of the model."""
    if watch.finding is None:
        return Status('payload', OK, 'no other payload is suspected')
    return Status('payload', WARN, watch.finding.text)


def joint_statuses(arm: Arm) -> list[Status]:
    """
    Return one status per joint, and restart the sums of its residual.

    In an open epoch a large residual is expected.
    """
    statuses, in_use, span = [], arm.in_use, arm.epoch.span()
    residual = arm.take_residual()
    outside = arm.outside
    for k, name in enumerate(arm.joints):
        values = {'range in this epoch [rad]': f'{span[k]:.3f}'}
        level, message = OK, 'no model' if in_use is None else 'ok'
        if in_use is not None and arm.pose is not None:
            values['training residual [Nm]'] = f'{in_use.model.noise[k]:.4f}'
            values['outside trained range [rad]'] = f'{outside[k]:.3f}'
        if in_use is not None and residual is not None:
            whole, other = residual[:, k]
            values['residual [Nm]'] = f'{whole:.4f}'
            values['residual beside friction [Nm]'] = f'{other:.4f}'
            message = f'residual {whole:.3g} N·m'
            ratio = other / expected_residual(in_use.model)[k]
            if not arm.epoch.is_open and ratio > CHECKS.max_unpredicted and (
                    not outside.any()):
                level = WARN
                message += (f', {ratio:.0f} times that of the training: another payload? call '
                            'payload_changed')
        statuses.append(Status(f'joint {name}', level, message, values))
    return statuses
