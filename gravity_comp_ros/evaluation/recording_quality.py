"""What a recording holds, joint by joint, and what nobody could judge from it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.gate import FAST, GateOptions, slow_samples
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

# Less travel than this is no motion; less than the second leaves most of a joint's sines and
# cosines looking like straight lines.
STILL = 0.01
NARROW = 0.3
# Fewer slow samples do not judge a model.
FEW = 50
_SLOW_SHARE = 0.1
_SLOW_TRAVEL = 0.3
# A joint turns back when it has moved this far against its last direction, rad.
_TURN = 0.01
# Share of the torque's variance that poses must explain somewhere for gravity to be in it.
_GRAVITY = 0.3
# Share of what poses leave unexplained that the direction of motion must explain before its
# sign means anything: less if several joints agree. Real arms reach 0.2 to 0.97 by friction.
_DIRECTION = 0.2
_DIRECTION_ALONE = 0.5
# The torque that goes with the direction must also be this part of the torque's range, or it
# may be a piece of gravity that the first-order fit has missed.
_DIRECTION_SIZE = 0.02


@dataclass(frozen=True)
class JointFacts:
    """
    One joint of a recording.

    Angles in rad, speeds in rad/s, torques in N·m. `reversals` counts changes of direction
    of more than 0.01 rad, None for poses at rest. `pose_share` is the part of the torque's
    variance that a first-order fit on all joint angles explains, None if nothing moves.
    `direction_share` is the part of the rest that the direction of motion explains, with the
    sign of its coefficient: friction makes it positive. `slow_travel` is the range of angles
    among the samples that the gate keeps.
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
    A recording: its joints, what the slow-motion gate lets through, and remarks.

    `slow_share` is the part of the samples in which every joint is slow; `kept` the number
    that the gate keeps of them after reducing their rate. `at_rest` says that every velocity
    is 0, as in a series of poses. `remarks` say in words what cannot be judged and why.
    `reversed_joints` are those whose effort should be read with the opposite sign.
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
                          _to_turn(joints))


def count_reversals(q: FloatArray, turn: float = _TURN) -> int:
    """
    Return how often a joint turns back by more than `turn`.

    :param q: angles (M,) in rad.
    """
    count, direction, extreme = 0, 0, q[0]
    for angle in q:
        if direction == 0:
            if abs(angle - extreme) > turn:
                direction, extreme = (1 if angle > extreme else -1), angle
        elif (angle - extreme) * direction >= 0:
            extreme = angle
        elif abs(angle - extreme) > turn:
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
    """Return the shares of the torque's variance that pose and direction of motion explain."""
    tau, qd = samples.tau[:, n], samples.qd[:, n]
    moving = np.ptp(samples.q, axis=0) > STILL
    poses = np.column_stack([np.ones(len(samples)), np.sin(samples.q[:, moving]),
                             np.cos(samples.q[:, moving])])
    if not moving.any() or tau.std() < 1e-9 or len(samples) < 4 * poses.shape[1]:
        return None, None
    rest = tau - poses @ lstsq(poses, tau)
    pose_share = float(1 - rest.var() / tau.var())
    fastest = float(np.abs(qd).max())
    if fastest == 0 or not moving[n] or rest.std() < 1e-9 * tau.std():
        return pose_share, None
    direction = np.tanh(qd / (0.05 * fastest))
    direction = direction - poses @ lstsq(poses, direction)
    if direction.std() < 1e-6:
        return pose_share, None
    slope = float(direction @ rest / (direction @ direction))
    if abs(slope) < _DIRECTION_SIZE * np.ptp(tau):
        return pose_share, 0.0
    share = slope ** 2 * float(direction.var() / rest.var())
    return pose_share, float(np.copysign(share, slope))


def _speed_remarks(joints: dict[str, JointFacts], slow_share: float, kept: int, total: int,
                   options: GateOptions) -> list[str]:
    limit = options.max_speed
    shown = f'{limit:g} rad/s' if isinstance(limit, float | int) else 'its limit'
    if slow_share < _SLOW_SHARE:
        fastest = max(joints, key=lambda name: joints[name].max_speed)
        return [f'too fast: every joint is under {shown} in only {100 * slow_share:.1f} % of the '
                f'samples ({kept} kept by the gate), {fastest} reaches '
                f'{joints[fastest].max_speed:.2f} rad/s; torque here is gravity, friction and '
                f'inertia together; `fit` can take it, with friction and inertia beside gravity, '
                f'but slow motion shows gravity better']
    if kept < FEW:
        return [f'short: the gate keeps {kept} of {total} samples, too few to judge a model']
    return []


def _slow_remarks(joints: dict[str, JointFacts], slow_share: float) -> list[str]:
    """Tell where the slow samples miss most of what the recording covers."""
    missed = [f'{name} ({facts.slow_travel:.2g} of {facts.travel:.2g} rad)'
              for name, facts in joints.items()
              if facts.travel >= STILL and facts.slow_travel < _SLOW_TRAVEL * facts.travel]
    if slow_share < _SLOW_SHARE or not missed:
        return []
    return [f'slow samples cover little of the motion: {", ".join(missed)}']


def _motion_remarks(joints: dict[str, JointFacts], at_rest: bool) -> list[str]:
    remarks = []
    still = [name for name, facts in joints.items() if facts.travel < STILL]
    narrow = [f'{name} ({facts.travel:.2g} rad)' for name, facts in joints.items()
              if STILL <= facts.travel < NARROW]
    if still:
        remarks.append(f'never moves: {", ".join(still)}; what gravity does there along that '
                       f'joint cannot be learned')
    if narrow:
        remarks.append(f'moves little: {", ".join(narrow)}; a model will hold only near there')
    if at_rest:
        remarks.append('poses at rest (every velocity is 0): friction cannot be judged, and '
                       'static friction stays in the torque')
        return remarks
    one_way = [name for name, facts in joints.items()
               if facts.travel >= STILL and facts.reversals == 0]
    if one_way:
        remarks.append(f'one way only: {", ".join(one_way)}; friction cannot be told from '
                       f'gravity without the way back')
    return remarks


def _reversed(joints: dict[str, JointFacts]) -> list[str]:
    """Return the joints whose effort has most likely the opposite sign."""
    shares = {name: facts.direction_share for name, facts in joints.items()
              if facts.direction_share is not None}
    agreed = [name for name, share in shares.items() if share < -_DIRECTION]
    if len(agreed) > 1 and max(shares.values()) < _DIRECTION:
        return agreed
    return [name for name, share in shares.items() if share < -_DIRECTION_ALONE]


def _to_turn(joints: dict[str, JointFacts]) -> tuple[str, ...]:
    """Return the joints to read with the opposite sign."""
    found = _reversed(joints)
    # One joint may be wired the other way round; several mean another convention.
    return tuple(joints) if len(found) > 1 else tuple(found)


def _effort_remarks(joints: dict[str, JointFacts]) -> list[str]:
    remarks = []
    constant = [name for name, facts in joints.items() if facts.tau_std < 1e-9]
    if constant:
        remarks.append(f'effort never changes: {", ".join(constant)}')
    reversed_ = _reversed(joints)
    if reversed_:
        scales = ','.join(f'{name}=-1' for name in _to_turn(joints))
        remarks.append(f'effort points against the motion on {", ".join(reversed_)}, which '
                       f'friction never does: its sign looks reversed; try '
                       f'--effort-scale {scales}')
    shares = [facts.pose_share for facts in joints.values()
              if facts.pose_share is not None and facts.travel > NARROW]
    if shares and max(shares) < _GRAVITY:
        remarks.append(f'effort hardly depends on the pose (at most {100 * max(shares):.0f} % of '
                       f'its variance): gravity may be compensated already by the drive')
    return remarks
