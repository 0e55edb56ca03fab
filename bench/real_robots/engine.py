"""The engine of `gravity_comp_ros.regression` on a case: one regression, then its prediction."""

from __future__ import annotations

from collections.abc import Iterable
from time import process_time
from typing import Any

from bench.real_robots.cases import Case, Run
from bench.real_robots.product import Outcome
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.description.urdf import parse_urdf
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.regression.engine import regress, Regression
from gravity_comp_ros.regression.known_axes import KnownAxes
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.shared import Shared, State
from gravity_comp_ros.regression.start import start_axes
from gravity_comp_ros.regression.term import Term
import numpy as np


def engine_loop(one: Case, described: bool) -> Outcome:
    """
    Return the outcome of one regression; terms with alternatives are ambiguous, others likely.

    :raises GravityCompError: if the regression fails.
    """
    start = process_time()
    problem = Problem.of(samples_of(one, one.train))
    effects = list(library_effects().values())
    shared = KnownAxes.of(parse_urdf(one.urdf, one.joints)) if described \
        else start_axes(problem, effects)
    result = regress(problem, shared, effects)
    seconds = {'regression': process_time() - start}
    terms = result.posterior.terms
    unseen, still = samples_of(one, [one.unseen]), at_rest(one)
    torque = predicted(result, unseen, terms)
    return Outcome([finding(one, result, term) for term in terms], torque,
                   predicted(result, still, [t for t in terms if t.effect.is_static]),
                   torque, tuple(f'{t.name}:{t.joint}' for t in terms), seconds)


def samples_of(one: Case, runs: Iterable[Run]) -> JointSamples:
    """Return runs as samples."""
    return concatenate([JointSamples.single_run(one.joints, run.t, run.q, run.qd, run.tau,
                                                f'run {k}') for k, run in enumerate(runs)])


def at_rest(one: Case) -> JointSamples:
    """Return the poses of the trained box as samples at rest."""
    q = one.poses
    return JointSamples.single_run(one.joints, np.arange(len(q), dtype=np.float64), q, 0.0 * q,
                                   0.0 * q)


def predicted(result: Regression, samples: JointSamples, terms: Iterable[Term]) -> FloatArray:
    """Return the torque (M, N) in N·m of gravity, dynamics and some terms."""
    shared: Shared = result.shared
    motion = Motion.of(samples, shared.gravity(samples.q), shared.gradient,
                       getattr(shared, 'chain', None), getattr(shared, 'geometry', None))
    state = State(samples.q, samples.qd, motion.qdd)
    total = shared.torque(state)
    for term in terms:
        columns = term.effect.columns(motion, term.joint_number, term.setting)
        torque = columns @ result.posterior.beta[result.posterior.at[term]]
        if columns.ndim == 3:
            total = total + torque
        else:
            total[:, term.joint_number] += torque
    return np.asarray(total)


def finding(one: Case, result: Regression, term: Term) -> dict[str, Any]:
    """Return a term as an entry of `diagnose --json`."""
    posterior, others = result.posterior, result.alternatives[term.key]
    values, std = posterior.beta[posterior.at[term]], posterior.std(term)
    listed = term.effect.coefficients_of(result.motion, term.joint_number, term.setting)
    identified = result.unabsorbed[term.key] >= result.problem.options.min_unabsorbed
    return {'joint': None if term.joint is None else one.joints[term.joint], 'effect': term.name,
            'verdict': 'ambiguous' if others else 'likely',
            'rivals': [name if joint == term.joint or joint is None
                       else f'{name}:{one.joints[joint]}' for name, joint in others],
            'coefficients': {c.symbol: {'value': float(x), 'unit': c.unit,
                                        'ci95': [float(x - 1.96 * s), float(x + 1.96 * s)]}
                             for c, x, s in zip(listed, values, std)} if identified else {}}
