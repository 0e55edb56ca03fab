"""
Choice between chain and potential by their error on held-out samples.

The chain has far fewer parameters, so it extrapolates better on a serial arm of rigid links. It
is wrong for other mechanisms (a balancer, a linkage), or if its search ends in a local minimum.
The chain is chosen if its residual is white, or if the residual of the potential is no smaller on
the same samples. Otherwise both are compared by cross-validation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.folds import folds
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.estimation.chain_estimate import (
    ChainEstimate, estimate_chain, residual_of)
from gravity_comp_ros.estimation.regression import Regression
from gravity_comp_ros.estimation.sparse_estimate import estimate_sparse, SparseEstimate
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, fit_chain
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.nuisance import OFFSET
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
import numpy as np

# Minimum number of samples at which a white residual is not due to over-fitting.
_MIN_WHITE_SAMPLES = 100
_WARM = SearchOptions(starts=1, rivals=0)
# Minimum relative decrease of some joint's residual for which the potential is considered.
_MIN_GAIN = 0.05
_FOLDS = 3
# Minimum variance inflation that the potential assumes, because a residual that is not white is
# autocorrelated.
_MIN_INFLATION = 4.0
# Minimum autocorrelated residual worth modelling: this share of the joint's gravity torque, plus
# this share of the largest joint's.
_MIN_OF_JOINT, _MIN_OF_ARM = 0.03, 0.003
# Maximum number of samples of the comparison, and of joints for which the potential is affordable.
_MAX_SAMPLES, _MAX_JOINTS = 300, 9
# Number of joints up to which the potential is compared even with a small residual.
_CHEAP_JOINTS = 4
# Minimum relative decrease of some joint's RMSE by free axes for which known axes are rejected.
MIN_GAIN_OF_FREE_AXES = 0.3


@dataclass(frozen=True, eq=False)
class Choice:
    """
    The chosen estimate and the reason.

    `held_out` are held-out errors by formulation, in multiples of the noise, empty without a
    comparison. `known_axes` is True if known axes were used, `warning` the reason if they were
    rejected.
    """

    estimate: ChainEstimate | SparseEstimate
    why: str
    held_out: Mapping[str, float] = field(default_factory=dict)
    known_axes: bool = False
    warning: str = ''

    @property
    def formulation(self) -> str:
        if isinstance(self.estimate, ChainEstimate):
            return 'chain'
        return 'per_joint' if self.estimate.energy is None else 'potential'


def choose(regression: Regression, options: SparseOptions, known: FloatArray | None = None,
           start: Chain | None = None, warm: bool = False, no_offsets: bool = False) -> Choice:
    """
    Fit the chain, and the potential if the chain's residual is not white.

    :param known: axes (N, 3, 3) of the chain that need no search.
    :param start: a chain to start from.
    :param warm: whether `start` is the only start.
    :param no_offsets: whether `start` was fitted without offsets: a chain without them is then
        chosen if its residual is as small.
    :raises FitError: if there are no samples.
    """
    chain, warning = _fit_chain(regression, known, start, warm)
    uses_known = known is not None and not warning
    m, n = chain.regression.samples.q.shape
    if not uses_known and n <= _MAX_JOINTS and _offsets(chain).any():
        simpler = _chain_without_offsets(chain, warm=True) if no_offsets else None
        sparse = None if simpler else _potential_without_offsets(chain, options)
        if sparse is not None:
            simpler = _chain_without_offsets(chain, warm=False)
        if simpler is not None:
            return Choice(simpler, 'the chain explains the torque without an offset', {}, False,
                          warning)
        if sparse is not None:
            return Choice(sparse, 'it explains the torque without the offset that the chain '
                          'requires', {}, False, warning)
    reason = None
    if chain.fit.clean and m >= _MIN_WHITE_SAMPLES and (chain.fit.inflation == 1.0).all():
        reason = 'the residual of the chain is white'
    elif n > _MAX_JOINTS:
        reason = f'the potential is not tried on more than {_MAX_JOINTS} joints'
    elif not _is_structured(chain):
        reason = 'the autocorrelated residual of the chain is small relative to gravity'
    if reason is not None:
        return Choice(chain, reason, {}, uses_known, warning)
    return _compare(chain, options, uses_known, warning)


def _compare(chain: ChainEstimate, options: SparseOptions, uses_known: bool,
             warning: str) -> Choice:
    """Fit the potential, and choose by the held-out error if its residual is smaller."""
    few = chain.regression.thinned(_MAX_SAMPLES)
    options = _with_inflation(options, chain, _MIN_INFLATION)
    sparse = estimate_sparse(few, 'potential', options, final_terms=True)
    rms = _rms(residual_of(_fit_again(chain, few), few))
    scale = np.maximum(rms, floor(few.samples.tau))
    if (rms <= (1.0 + _MIN_GAIN) * np.maximum(_rms(sparse.residual()), scale * 1e-9)).all():
        return Choice(chain, 'the residual of the potential is no smaller than that of the chain',
                      {}, uses_known, warning)
    errors = np.array([_held_out(few, test, chain, sparse, options, scale)
                       for test in folds(few.samples.runs, _FOLDS)])
    means = np.sqrt(errors.mean(axis=0))
    held_out = dict(zip(('chain', 'potential'), means.tolist()))
    chosen, other = ('chain', 'potential') if means[0] <= means[1] else ('potential', 'chain')
    why = (f'on held-out samples the error of the {chosen} is {held_out[chosen]:.2f} and that of '
           f'the {other} {held_out[other]:.2f} times the noise')
    if chosen == 'chain':
        return Choice(chain, why, held_out, uses_known, warning)
    return Choice(_fit_all(sparse, few, chain, options, True), why, held_out, False, warning)


def _with_inflation(options: SparseOptions, chain: ChainEstimate,
                    minimum: float) -> SparseOptions:
    """Return the options, with the variance inflation of the chain's residual if not given."""
    if options.inflation is not None:
        return options
    return replace(options, inflation=max(minimum, float(np.median(chain.fit.inflation))))


def _fit_all(sparse: SparseEstimate, few: Regression, chain: ChainEstimate,
             options: SparseOptions, final_terms: bool) -> SparseEstimate:
    """Return the potential fitted to all samples, starting from that of a few."""
    return sparse if few is chain.regression else estimate_sparse(
        chain.regression, 'potential', options, sparse.energy, final_terms)


def _chain_without_offsets(chain: ChainEstimate, warm: bool) -> ChainEstimate | None:
    """
    Return the chain fitted again without offsets, if its residual is as small.

    A wrong chain may require an offset, so the chain is searched again unless `warm`.
    """
    regression = chain.regression
    kept = [k for k, c in enumerate(regression.nuisance.columns) if c.kind != OFFSET]
    offsets = frozenset((OFFSET, n) for n in range(regression.samples.n_joints))
    simpler = estimate_chain(replace(regression.with_terms(kept),
                                     excluded=regression.excluded | offsets),
                             None, chain.chain if warm else None, warm, max_searches=1)
    limit = (1.0 + _MIN_GAIN) * _rms(chain.residual()) + floor(regression.samples.tau)
    return simpler if (_rms(simpler.residual()) <= limit).all() else None


def _potential_without_offsets(chain: ChainEstimate,
                               options: SparseOptions) -> SparseEstimate | None:
    """
    Return the potential if it fits as well with less than half of the chain's offsets.

    A wrong chain may require a constant torque that gravity does not have.
    """
    few = chain.regression.thinned(_MAX_SAMPLES)
    options = _with_inflation(options, chain, 1.0)
    sparse = estimate_sparse(few, 'potential', options)
    rms = _rms(residual_of(_fit_again(chain, few), few))
    if (_rms(sparse.residual()) > (1.0 + _MIN_GAIN) * rms + floor(few.samples.tau)).any():
        return None
    if _offsets(sparse).sum() > 0.5 * _offsets(chain).sum():
        return None
    return _fit_all(sparse, few, chain, options, False)


def _is_structured(chain: ChainEstimate) -> bool:
    """
    Return whether some joint's autocorrelated residual is large relative to gravity.

    An offset counts as residual: that of a wrong chain may be a part of gravity.
    """
    residual, samples = chain.residual(), chain.regression.samples
    if samples.n_joints <= _CHEAP_JOINTS:
        return True
    power = np.maximum((residual ** 2).sum(axis=0), 1e-300)
    autocorrelation = np.maximum((residual[1:] * residual[:-1]).sum(axis=0) / power, 0.0)
    structured = np.sqrt(autocorrelation) * _rms(residual) + _offsets(chain)
    gravity = _rms(chain.chain.torque(samples.q))
    return bool((structured > _MIN_OF_JOINT * gravity + _MIN_OF_ARM * gravity.max()).any())


def _offsets(estimate: ChainEstimate | SparseEstimate) -> FloatArray:
    """Return the size of each joint's offset (N,), N·m."""
    regression = estimate.regression
    offsets = np.zeros(regression.samples.n_joints)
    for k, column in enumerate(regression.nuisance.columns, regression.n_effects):
        if column.kind == OFFSET:
            offsets[column.joint] = abs(estimate.coefficients[k])
    return offsets


def _fit_chain(regression: Regression, known: FloatArray | None,
               start: Chain | None, warm: bool) -> tuple[ChainEstimate, str]:
    """Return the chain on known axes, or on free axes with a warning if those fit much better."""
    if known is None:
        return estimate_chain(regression, None, start, warm), ''
    fixed = estimate_chain(regression, known)
    if fixed.fit.clean:
        return fixed, ''
    free = estimate_chain(regression, start=fixed.chain)
    rms, free_rms = _rms(fixed.residual()), _rms(free.residual())
    worst = int(np.argmax(rms / np.maximum(free_rms, floor(regression.samples.tau))))
    if free_rms[worst] >= (1.0 - MIN_GAIN_OF_FREE_AXES) * rms[worst]:
        return fixed, ''
    name = regression.samples.names[worst]
    return free, (f'the description is not used: with its axes the residual torque of {name} is '
                  f'{rms[worst]:.2g} N·m, with free axes {free_rms[worst]:.2g} N·m. Check that it '
                  f'is of this arm and has the same zero angles')


def _fit_again(chain: ChainEstimate, regression: Regression) -> ChainFit:
    return chain.fit if regression is chain.regression else fit_chain(
        regression.samples, _WARM, chain.chain, None, regression.linear_terms())


def _held_out(regression: Regression, test: BoolArray, chain: ChainEstimate,
              sparse: SparseEstimate, options: SparseOptions,
              scale: FloatArray) -> tuple[float, float]:
    """Return the mean square errors of chain and potential on `test`, fitted without it."""
    train, unseen = regression.select(~test), regression.select(test)
    refitted = fit_chain(train.samples, _WARM, chain.chain, None, train.linear_terms())
    energy = estimate_sparse(train, 'potential', options, sparse.energy, final_terms=True)
    errors = (residual_of(refitted, unseen),
              unseen.residual(energy.gravity(unseen.samples.q), energy.coefficients))
    weights = unseen.robust_weights
    return (float((weights * (errors[0] / scale) ** 2).mean()),
            float((weights * (errors[1] / scale) ** 2).mean()))


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((values ** 2).mean(axis=0)))
