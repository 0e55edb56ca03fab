"""The public loop on a case: fit, diagnose, add what is established or likely, predict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from time import process_time
from typing import Any

from bench.real_robots import arms
from bench.real_robots.cases import Case, Run
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import FloatArray
import numpy as np

# Effects that act at rest; friction and dynamics do not.
STATIC = ('torque_offset', 'torque_gain', 'joint_spring', 'cable_stiffness', 'torque_ripple',
          'end_stop', 'encoder_offset', 'base_tilt', 'tool_force', 'joint_flexibility')
# Effects that LuGre friction consists of.
LUGRE = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'presliding_hysteresis')


@dataclass(eq=False)
class Outcome:
    """
    Output of the loop: arguments of `score.score`, and what the steps said and took.

    `seconds` are the processor times of the steps, `before` the worst error on the unseen run
    before the effects were added, in noise levels. `refused` is the reason why `add` failed.
    """

    findings: list[dict[str, Any]]
    torque: FloatArray
    static: FloatArray
    before: FloatArray
    added: tuple[str, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    refused: str = ''


def recording(joints: Sequence[str], runs: Sequence[Run],
              gate: gc.GateOptions | None = gc.GateOptions()) -> gc.Recording:
    """Return runs as a recording."""
    return gc.Recording.from_arrays(
        [run.q for run in runs], [run.tau for run in runs], [run.t for run in runs],
        qd=[run.qd for run in runs], names=joints, gate=gate)


def loop(one: Case, described: bool) -> Outcome:
    """
    Run the loop on a case, with the description of the arm if `described`.

    :raises GravityCompError: if fit or diagnosis fail.
    """
    train = recording(one.joints, one.train)
    seconds: dict[str, float] = {}
    start = process_time()
    model = fit(one, train, described)
    seconds['fit'] = process_time() - start
    before = predicted(one, model)
    start = process_time()
    diagnosis = gc.diagnose(train, model)
    seconds['diagnose'] = process_time() - start
    start, refused = process_time(), ''
    try:
        model = gc.add_effects(model, train, diagnosis.findings)
    except gc.GravityCompError as problem:
        refused = str(problem)
    seconds['add'] = process_time() - start
    return Outcome(diagnosis.to_json()['findings'], predicted(one, model),
                   static_part(model, one.joints, one.poses), before, tuple(model.effects),
                   seconds, refused)


def oracle(one: Case) -> FloatArray:
    """
    Return the torque (M, N) on the unseen run of a fit given description and true effects.

    Asymmetric friction of a joint that hardly rests is the column of an offset, and given as one.
    """
    effects = {'rigid_body_dynamics'}
    for truth in one.hidden:
        name = 'torque_offset' if truth.effect == 'asymmetric_friction' else truth.effect
        effects.add(f'{name}:{one.joints[truth.joint]}')
    rubbing = {f.joint for f in one.friction} | {h.joint for h in one.hidden if h.allowed}
    effects |= {f'{name}:{one.joints[joint]}' for joint in rubbing for name in LUGRE}
    train = recording(one.joints, one.train)
    return predicted(one, fit(one, train, True, sorted(effects)))


def fit(one: Case, train: gc.Recording, described: bool, effects: Sequence[str] = ()) -> gc.Model:
    """Return the fit of a recording, with the description of the arm if `described`."""
    if not described:
        return gc.fit(train, effects=effects)
    with arms.described(one.urdf, one.seed) as path:
        return gc.fit(train, urdf=path, effects=effects)


def predicted(one: Case, model: gc.Model) -> FloatArray:
    """Return the model's torque (M, N) in N·m on the unseen run, in the order of the case."""
    torque = model.torque(recording(one.joints, [one.unseen], None))
    return torque[:, [model.joints.index(name) for name in one.joints]]


def static_part(model: gc.Model, joints: Sequence[str], q: FloatArray) -> FloatArray:
    """Return the torque (K, N) in N·m of gravity and static effects in poses q (K, N) in rad."""
    applied = replace(model.gravity.applied, effects=tuple(
        effect for effect in model.gravity.applied.effects if effect.name in STATIC))
    still = gc.Recording.from_arrays(q, np.zeros_like(q), np.arange(len(q), dtype=np.float64),
                                     qd=np.zeros_like(q), names=joints, gate=None)
    torque = gc.Model(replace(model.gravity, applied=applied)).torque(still)
    return torque[:, [model.joints.index(name) for name in joints]]
