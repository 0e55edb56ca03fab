"""
Chain or potential: which of the two predicts samples that it was not fitted to.

The chain has far fewer parameters, so it extrapolates where it is true, and it is wrong where the
arm is no serial chain of rigid links (a balancer, a linkage) or its search ended in a wrong
minimum. Where the chain's residual is white, or the potential explains no more of the same
samples, the chain is taken. Otherwise both are fitted to the same folds and compared on what
those leave out.
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

# With fewer samples than this a clean residual may be an over-fitted one.
_ENOUGH = 100
_WARM = SearchOptions(starts=1, rivals=0)
# The potential must explain this share more of some joint's residual to be considered.
_MORE = 0.05
_FOLDS = 3
# What is missing is still in the torque and correlated: a few samples count as one.
_CAUTIOUS = 4.0
# A residual that repeats is worth explaining above this share of the joint's gravity torque, plus
# this share of the arm's largest.
_WORTHWHILE, _OF_LARGEST = 0.03, 0.003
# Samples that the comparison is made on, and joints beyond which the potential is too dear to try.
_COMPARED, _MOST_JOINTS = 300, 9
# With so few joints the potential costs next to nothing.
_CHEAP_JOINTS = 4
# Known axes are another arm's if a free chain takes this share off some joint's RMSE.
OTHER_ARM = 0.3


@dataclass(frozen=True, eq=False)
class Choice:
    """
    What was chosen and why, with the estimates that were made on the way.

    `held_out` are errors in multiples of the noise by formulation, empty where no comparison was
    needed. `known_axes` says whether known axes were used, `warning` why they were not.
    """

    estimate: ChainEstimate | SparseEstimate
    why: str
    held_out: Mapping[str, float] = field(default_factory=dict)
    known_axes: bool = False
    warning: str = ''

    @property
    def formulation(self) -> str:
        return 'chain' if isinstance(self.estimate, ChainEstimate) else 'potential'


def choose(regression: Regression, options: SparseOptions, known: FloatArray | None = None,
           start: Chain | None = None, warm: bool = False, bare: bool = False) -> Choice:
    """
    Fit the chain, and the potential where the chain leaves something to explain.

    :param known: axes (N, 3, 3) of the chain that need no search.
    :param start: a chain to begin with.
    :param warm: whether no other starts than that are tried.
    :param bare: whether the chain to begin with was found without offsets: then they are taken
        only if the torque asks for them.
    :raises FitError: if there are no samples.
    """
    chain, warning = _chain(regression, known, start, warm)
    uses_known = known is not None and not warning
    m, n = chain.regression.samples.q.shape
    if not uses_known and n <= _MOST_JOINTS and _offsets(chain).any():
        without = _bare(chain) if bare else None
        if without is not None:
            return Choice(without, 'the chain explains the torque without an offset', {}, False,
                          warning)
        plain = _without_offset(chain, options)
        if plain is not None:
            return Choice(plain, 'it explains the torque without the offset that the chain needs',
                          {}, False, warning)
    if chain.fit.clean and m >= _ENOUGH and (chain.fit.inflation == 1.0).all():
        return Choice(chain, 'the dictionary explains no more of the residual of the chain than '
                      'of white noise', {}, uses_known, warning)
    if n > _MOST_JOINTS:
        return Choice(chain, f'the potential is not tried on more than {_MOST_JOINTS} joints', {},
                      uses_known, warning)
    if not _is_structured(chain):
        return Choice(chain, 'what the residual of the chain repeats is small beside gravity', {},
                      uses_known, warning)
    few = chain.regression.thinned(_COMPARED)
    if options.inflation is None:
        options = replace(options, inflation=max(_CAUTIOUS, float(np.median(
            chain.fit.inflation))))
    sparse = estimate_sparse(few, 'potential', options, settled=True)
    left = _rms(residual_of(_refit(chain, few), few))
    scale = np.maximum(left, floor(few.samples.tau))
    if (left <= (1.0 + _MORE) * np.maximum(_rms(sparse.residual()), scale * 1e-9)).all():
        return Choice(chain, 'the potential explains no more of the torque than the chain', {},
                      uses_known, warning)
    errors = np.array([_held_out(few, test, chain, sparse, options, scale)
                       for test in folds(few.samples.runs, _FOLDS)])
    means = np.sqrt(errors.mean(axis=0))
    held_out = dict(zip(('chain', 'potential'), means.tolist()))
    taken = 'chain' if means[0] <= means[1] else 'potential'
    other = 'potential' if taken == 'chain' else 'chain'
    why = (f'on held-out samples the error of the {taken} is {held_out[taken]:.2f} and that of '
           f'the {other} {held_out[other]:.2f} times the noise')
    if taken == 'chain':
        return Choice(chain, why, held_out, uses_known, warning)
    full = sparse if few is chain.regression else estimate_sparse(
        chain.regression, 'potential', options, sparse.energy, settled=True)
    return Choice(full, why, held_out, False, warning)


def _bare(chain: ChainEstimate) -> ChainEstimate | None:
    """Return the chain fitted anew without offsets, if it explains as much."""
    regression = chain.regression
    kept = [k for k, c in enumerate(regression.nuisance.columns) if c.kind != OFFSET]
    none = frozenset((OFFSET, n) for n in range(regression.samples.n_joints))
    found = estimate_chain(replace(regression.with_terms(kept),
                                   excluded=regression.excluded | none), None, chain.chain, True)
    limit = (1.0 + _MORE) * _rms(chain.residual()) + floor(regression.samples.tau)
    return found if (_rms(found.residual()) <= limit).all() else None


def _without_offset(chain: ChainEstimate, options: SparseOptions) -> SparseEstimate | None:
    """
    Return the potential if it explains as much with less than half of the chain's offsets.

    A wrong chain may need a constant torque that gravity has no part in.
    """
    few = chain.regression.thinned(_COMPARED)
    if options.inflation is None:
        options = replace(options, inflation=max(1.0, float(np.median(chain.fit.inflation))))
    sparse = estimate_sparse(few, 'potential', options)
    left = _rms(residual_of(_refit(chain, few), few))
    if (_rms(sparse.residual()) > (1.0 + _MORE) * left + floor(few.samples.tau)).any():
        return None
    if _offsets(sparse).sum() > 0.5 * _offsets(chain).sum():
        return None
    return sparse if few is chain.regression else estimate_sparse(
        chain.regression, 'potential', options, sparse.energy)


def _is_structured(chain: ChainEstimate) -> bool:
    """
    Return whether some joint's residual holds more than noise, on the scale of gravity.

    An offset counts as residual: a wrong chain may leave a constant that is gravity.
    """
    residual, samples = chain.residual(), chain.regression.samples
    if samples.n_joints <= _CHEAP_JOINTS:
        return True
    power = np.maximum((residual ** 2).sum(axis=0), 1e-300)
    likeness = np.maximum((residual[1:] * residual[:-1]).sum(axis=0) / power, 0.0)
    repeats = np.sqrt(likeness) * _rms(residual) + _offsets(chain)
    gravity = _rms(chain.chain.torque(samples.q))
    return bool((repeats > _WORTHWHILE * gravity + _OF_LARGEST * gravity.max()).any())


def _offsets(estimate: ChainEstimate | SparseEstimate) -> FloatArray:
    """Return the size of each joint's offset (N,), N·m."""
    regression = estimate.regression
    found = np.zeros(regression.samples.n_joints)
    for k, column in enumerate(regression.nuisance.columns, regression.n_effects):
        if column.kind == OFFSET:
            found[column.joint] = abs(estimate.beside[k])
    return found


def _chain(regression: Regression, known: FloatArray | None,
           start: Chain | None, warm: bool) -> tuple[ChainEstimate, str]:
    """Return the chain on known axes, unless they are another arm's; else on free ones."""
    if known is None:
        return estimate_chain(regression, None, start, warm), ''
    fixed = estimate_chain(regression, known)
    if fixed.fit.clean:
        return fixed, ''
    free = estimate_chain(regression, start=fixed.chain)
    left, least = _rms(fixed.residual()), _rms(free.residual())
    worst = int(np.argmax(left / np.maximum(least, floor(regression.samples.tau))))
    if least[worst] >= (1.0 - OTHER_ARM) * left[worst]:
        return fixed, ''
    name = regression.samples.names[worst]
    return free, (f'the description is not used: with its axes {left[worst]:.2g} N·m of the '
                  f'torque of {name} stay unexplained, without them {least[worst]:.2g} N·m. Is '
                  f'it of this arm, with the same zero angles?')


def _refit(chain: ChainEstimate, regression: Regression) -> ChainFit:
    return chain.fit if regression is chain.regression else fit_chain(
        regression.samples, _WARM, chain.chain, None, regression.beside())


def _held_out(regression: Regression, test: BoolArray, chain: ChainEstimate,
              sparse: SparseEstimate, options: SparseOptions,
              scale: FloatArray) -> tuple[float, float]:
    """Return the mean square errors of chain and potential on `test`, fitted without it."""
    train, unseen = regression.select(~test), regression.select(test)
    refitted = fit_chain(train.samples, _WARM, chain.chain, None, train.beside())
    energy = estimate_sparse(train, 'potential', options, sparse.energy, settled=True)
    errors = (residual_of(refitted, unseen),
              unseen.residual(energy.gravity(unseen.samples.q), energy.beside))
    weights = unseen.trust
    return (float((weights * (errors[0] / scale) ** 2).mean()),
            float((weights * (errors[1] / scale) ** 2).mean()))


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((values ** 2).mean(axis=0)))
