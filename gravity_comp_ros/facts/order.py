"""Joint order: a first joint that carries gravity, while one further out carries none."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.friction import shares
from gravity_comp_ros.facts.options import FactOptions
import numpy as np

# Joints at the end of an arm that may carry little gravity in their own right: the wrist.
_WRIST = 3
_MAX_SAMPLES = 2000


def order_facts(samples: JointSamples, order: Sequence[str],
                options: FactOptions = FactOptions()) -> list[Fact]:
    """
    Return the fact that another joint than the first has the torques of a vertical axis.

    Such a joint carries no gravity, and no torque depends on its angle.

    :param order: the joints from the base outwards, by their names.
    """
    if len(samples) < options.min_samples or len(order) <= _WRIST + 1:
        return []
    step = -(-len(samples) // _MAX_SAMPLES)
    q, qd, tau = samples.q[::step], samples.qd[::step], samples.tau[::step]
    wide = np.ptp(q, axis=0) > options.wide_travel
    carries = [(shares(q, qd, tau, n, options).gravity or 0.0) >= options.min_pose_share
               for n in range(samples.n_joints)]
    names = samples.names
    first = names.index(order[0])
    free = [name for name in order[1:-_WRIST] if wide[n := names.index(name)]
            and not carries[n] and not _matters(q, qd, tau, n, carries, options)]
    if not (carries[first] and len(free) == 1):
        return []
    return [Fact(
        Kind.ORDER, (order[0], free[0]), f'{order[0]} carries gravity, while {free[0]} has the '
        f'torques of a vertical first joint: it carries none, and no torque depends on its angle',
        Action.NOTED, 'the values may be in another order than the names, as after a sort by '
        'name; unless the base is tilted, correct the names',
        f'--rename {order[0]}={free[0]},{free[0]}={order[0]} exchanges these two')]


def _matters(q: FloatArray, qd: FloatArray, tau: FloatArray, joint: int, carries: Sequence[bool],
             options: FactOptions) -> bool:
    """Return whether the torque of another joint depends on the angle of `joint`."""
    others = [n for n in range(q.shape[1]) if np.ptp(q[:, n]) > options.min_travel and n != joint]
    angles = q[:, others]
    pairs = [f(q[:, a] + sign * q[:, b]) for i, a in enumerate(others) for b in others[i + 1:]
             for sign in (1.0, -1.0) for f in (np.sin, np.cos)]
    base = np.column_stack([np.ones(len(q)), np.sin(angles), np.cos(angles), *pairs])
    with_joint = np.column_stack([base, np.sin(q[:, joint]), np.cos(q[:, joint])])
    for n, is_loaded in enumerate(carries):
        if not is_loaded or n == joint:
            continue
        speed = qd[:, n]
        fastest = max(float(np.abs(speed).max()), 1e-9)
        friction = np.column_stack([np.tanh(speed / (0.05 * fastest)), speed])
        without, both = (_rest(np.column_stack([columns, friction]), tau[:, n])
                         for columns in (base, with_joint))
        if without - both > (options.min_gravity * tau[:, n].std()) ** 2:
            return True
    return False


def _rest(columns: FloatArray, values: FloatArray) -> float:
    """Return the variance of the residual."""
    solution = np.linalg.lstsq(columns, values, rcond=1e-8)[0]
    return float((values - columns @ solution).var())
