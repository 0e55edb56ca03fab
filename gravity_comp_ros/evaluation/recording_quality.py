"""Quality of a recording: facts of each joint, and remarks on unidentifiable terms."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.gate import FAST, GateOptions, slow_samples
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

# Minimum joint travel, in rad, that counts as motion, and below which sine and cosine of the
# angle are nearly linear.
_MIN_TRAVEL, _MIN_WIDE_TRAVEL = 0.01, 0.3
# Minimum number of slow samples for the evaluation of a model.
_MIN_SLOW_SAMPLES = 50
# Minimum share of slow samples, and of the travel that they cover.
_MIN_SLOW_SHARE, _MIN_SLOW_TRAVEL = 0.1, 0.3
# Minimum motion in the opposite direction, in rad, that counts as a reversal.
_MIN_REVERSAL = 0.01
# Minimum share of some joint's torque variance that depends on the pose, if it contains gravity.
_MIN_POSE_SHARE = 0.3
# Minimum share of the residual variance of the pose that the direction of motion must explain
# for a decision on the sign, on several joints and on a single one. Friction of real arms
# explains 0.2 to 0.97.
_MIN_DIRECTION_SHARE, _MIN_SINGLE_SHARE = 0.2, 0.5
# Minimum torque of the direction, as a share of the torque's range: a smaller one may be gravity
# that the first-order fit does not model.
_MIN_DIRECTION_TORQUE = 0.02


@dataclass(frozen=True)
class JointFacts:
    """
    One joint of a recording.

    Angles in rad, speeds in rad/s, torques in N·m. `reversals` is the number of reversals of
    more than 0.01 rad, None for poses at rest. `pose_share` is the share of the torque's variance
    explained by a first-order fit on all joint angles, None without motion. `direction_share` is
    the share of the residual explained by the direction of motion, with the sign of its
    coefficient, which is positive for friction. `slow_travel` is the range of angles of the
    samples that the gate keeps.
    """

    q_min: float
    q_max: float
    max_speed: float
    rms_speed: float
    reversals: int | None
    tau_min: float
    tau_max: float
    tau_std: float
    pose_share: float | None
    direction_share: float | None
    slow_travel: float

    @property
    def travel(self) -> float:
        return self.q_max - self.q_min


@dataclass(frozen=True)
class RecordingFacts:
    """
    A recording: its joints, the result of the slow-motion gate, and remarks.

    `slow_share` is the share of samples in which every joint is slow; `kept` the number of them
    after the gate has reduced the rate. `at_rest` is True if every velocity is 0, as in a series
    of poses. `remarks` are sentences on unidentifiable terms, with reasons. `reversed_joints` are
    those whose effort should be read with the opposite sign.
    """

    joints: dict[str, JointFacts]
    n_samples: int
    slow_share: float
    kept: int
    at_rest: bool
    remarks: tuple[str, ...]
    reversed_joints: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the facts as `info --json` prints them."""
        joints = {name: asdict(joint) for name, joint in self.joints.items()}
        for joint in joints.values():
            del joint['slow_travel']
        return {'joints': joints, 'slow_share': self.slow_share, 'kept': self.kept,
                'at_rest': self.at_rest, 'remarks': list(self.remarks)}


def describe(samples: JointSamples, options: GateOptions = GateOptions()) -> RecordingFacts:
    """Return the facts about a recording of one or several runs."""
    gate = slow_samples(samples, options)
    slow_share = 1 - gate.dropped.get(FAST, 0) / max(len(samples), 1)
    at_rest = not samples.qd.any()
    joints = {name: _joint(samples, n, at_rest, gate.samples)
              for n, name in enumerate(samples.names)}
    remarks = (*_speed_remarks(joints, slow_share, gate.kept, len(samples), options),
               *_slow_remarks(joints, slow_share), *_motion_remarks(joints, at_rest),
               *_effort_remarks(joints))
    return RecordingFacts(joints, len(samples), slow_share, gate.kept, at_rest, remarks,
                          _joints_to_reverse(joints))


def count_reversals(q: FloatArray, minimum: float = _MIN_REVERSAL) -> int:
    """
    Return the number of reversals of a joint.

    :param q: angles (M,) in rad.
    :param minimum: motion in rad in the opposite direction that counts.
    """
    count, direction, extreme = 0, 0, q[0]
    for angle in q:
        if direction == 0:
            if abs(angle - extreme) > minimum:
                direction, extreme = (1 if angle > extreme else -1), angle
        elif (angle - extreme) * direction >= 0:
            extreme = angle
        elif abs(angle - extreme) > minimum:
            count, direction, extreme = count + 1, -direction, angle
    return count


def _joint(samples: JointSamples, n: int, at_rest: bool, slow: JointSamples) -> JointFacts:
    q, qd, tau = samples.q[:, n], samples.qd[:, n], samples.tau[:, n]
    reversals = None if at_rest else sum(
        count_reversals(run.q[:, n]) for run in samples.each_run() if len(run))
    pose, direction = _shares(samples, n)
    return JointFacts(
        float(q.min()), float(q.max()), float(np.abs(qd).max()), float(np.sqrt(np.mean(qd ** 2))),
        reversals, float(tau.min()), float(tau.max()), float(tau.std()), pose, direction,
        float(np.ptp(slow.q[:, n])) if len(slow) else 0.0)


def _shares(samples: JointSamples, n: int) -> tuple[float | None, float | None]:
    """Return the shares of the torque's variance explained by pose and direction of motion."""
    tau, qd = samples.tau[:, n], samples.qd[:, n]
    moving = np.ptp(samples.q, axis=0) > _MIN_TRAVEL
    poses = np.column_stack([np.ones(len(samples)), np.sin(samples.q[:, moving]),
                             np.cos(samples.q[:, moving])])
    if not moving.any() or tau.std() < 1e-9 or len(samples) < 4 * poses.shape[1]:
        return None, None
    residual = tau - poses @ lstsq(poses, tau)
    pose_share = float(1 - residual.var() / tau.var())
    fastest = float(np.abs(qd).max())
    if fastest == 0 or not moving[n] or residual.std() < 1e-9 * tau.std():
        return pose_share, None
    direction = np.tanh(qd / (0.05 * fastest))
    direction = direction - poses @ lstsq(poses, direction)
    if direction.std() < 1e-6:
        return pose_share, None
    slope = float(direction @ residual / (direction @ direction))
    if abs(slope) < _MIN_DIRECTION_TORQUE * np.ptp(tau):
        return pose_share, 0.0
    share = slope ** 2 * float(direction.var() / residual.var())
    return pose_share, float(np.copysign(share, slope))


def _speed_remarks(joints: dict[str, JointFacts], slow_share: float, kept: int, total: int,
                   options: GateOptions) -> list[str]:
    limit = options.max_speed
    limit_text = f'{limit:g} rad/s' if isinstance(limit, float | int) else 'its limit'
    if slow_share < _MIN_SLOW_SHARE:
        fastest = max(joints, key=lambda name: joints[name].max_speed)
        return [f'too fast: every joint is under {limit_text} in only {100 * slow_share:.1f} % of '
                f'the samples ({kept} kept by the gate), {fastest} reaches '
                f'{joints[fastest].max_speed:.2f} rad/s; the torque is gravity, friction and '
                f'inertia together; `fit` can use it, with friction and inertia as nuisance '
                f'terms, but gravity is more accurate from slow motion']
    if kept < _MIN_SLOW_SAMPLES:
        return [f'short: the gate keeps {kept} of {total} samples, too few to evaluate a model']
    return []


def _slow_remarks(joints: dict[str, JointFacts], slow_share: float) -> list[str]:
    """Return a remark if the slow samples cover little of the recorded travel."""
    missed = [f'{name} ({facts.slow_travel:.2g} of {facts.travel:.2g} rad)'
              for name, facts in joints.items()
              if facts.travel >= _MIN_TRAVEL
              and facts.slow_travel < _MIN_SLOW_TRAVEL * facts.travel]
    if slow_share < _MIN_SLOW_SHARE or not missed:
        return []
    return [f'slow samples cover little of the motion: {", ".join(missed)}']


def _motion_remarks(joints: dict[str, JointFacts], at_rest: bool) -> list[str]:
    remarks = []
    still = [name for name, facts in joints.items() if facts.travel < _MIN_TRAVEL]
    narrow = [f'{name} ({facts.travel:.2g} rad)' for name, facts in joints.items()
              if _MIN_TRAVEL <= facts.travel < _MIN_WIDE_TRAVEL]
    if still:
        remarks.append(f'never moves: {", ".join(still)}; gravity at other angles of that joint '
                       f'is not identifiable')
    if narrow:
        remarks.append(f'moves little: {", ".join(narrow)}; a model is valid only near these '
                       f'angles')
    if at_rest:
        remarks.append('poses at rest (every velocity is 0): friction is not identifiable, and '
                       'static friction remains in the torque')
        return remarks
    one_way = [name for name, facts in joints.items()
               if facts.travel >= _MIN_TRAVEL and facts.reversals == 0]
    if one_way:
        remarks.append(f'one direction only: {", ".join(one_way)}; friction cannot be separated '
                       f'from gravity without motion in the other direction')
    return remarks


def _reversed(joints: dict[str, JointFacts]) -> list[str]:
    """Return the joints whose effort most probably has the opposite sign."""
    shares = {name: facts.direction_share for name, facts in joints.items()
              if facts.direction_share is not None}
    agreed = [name for name, share in shares.items() if share < -_MIN_DIRECTION_SHARE]
    if len(agreed) > 1 and max(shares.values()) < _MIN_DIRECTION_SHARE:
        return agreed
    return [name for name, share in shares.items() if share < -_MIN_SINGLE_SHARE]


def _joints_to_reverse(joints: dict[str, JointFacts]) -> tuple[str, ...]:
    """Return the joints to read with the opposite sign."""
    reversed_ = _reversed(joints)
    # A single joint may have reversed wiring; several indicate another sign convention.
    return tuple(joints) if len(reversed_) > 1 else tuple(reversed_)


def _effort_remarks(joints: dict[str, JointFacts]) -> list[str]:
    remarks = []
    constant = [name for name, facts in joints.items() if facts.tau_std < 1e-9]
    if constant:
        remarks.append(f'effort never changes: {", ".join(constant)}')
    reversed_ = _reversed(joints)
    if reversed_:
        scales = ','.join(f'{name}=-1' for name in _joints_to_reverse(joints))
        remarks.append(f'effort points against the motion on {", ".join(reversed_)}, opposite '
                       f'to friction: its sign looks reversed; try --effort-scale {scales}')
    shares = [facts.pose_share for facts in joints.values()
              if facts.pose_share is not None and facts.travel > _MIN_WIDE_TRAVEL]
    if shares and max(shares) < _MIN_POSE_SHARE:
        remarks.append(f'effort hardly depends on the pose (at most {100 * max(shares):.0f} % of '
                       f'its variance): the drive may compensate gravity already')
    return remarks
