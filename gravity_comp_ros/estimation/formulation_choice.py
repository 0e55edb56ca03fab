"""
Chain or potential: which of the two predicts what it has not seen.

The chain is the stronger statement, so it is right further out where it is true, and wrong
where the arm is no serial chain of rigid links (a spring, a counterweight on a linkage) or its
search ended in the wrong place. Both show. Where enough independent samples leave a residual in
which no feature of the dictionary finds anything, there is nothing left for the potential to do
better. Otherwise both are fitted to the same folds and judged on what those leave out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.folds import folds
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, fit_chain
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.models.sparse.potential import fit_potential
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit, SparseOptions
import numpy as np

# With fewer samples than this a clean residual may be an over-fitted one.
_ENOUGH = 100
_WARM = SearchOptions(starts=1, rivals=0)


@dataclass(frozen=True)
class Choice:
    """
    What was chosen, in a word and in a sentence, and what was fitted on the way.

    `errors` are the held-out errors of chain and potential in units of the noise, empty where
    no comparison was needed; `energy` and `fits` are the potential's, None and empty likewise.
    """

    formulation: str
    why: str
    chain: ChainFit
    energy: Expansion | None
    fits: list[SparseFit]
    errors: tuple[float, ...]


def choose(samples: JointSamples, options: SparseOptions,
           known: FloatArray | None = None) -> Choice:
    """
    Fit the chain, and the potential where the chain leaves something to explain.

    :param known: axes (N, 3, 3) of the chain that need no search.
    :raises FitError: if there are no samples.
    """
    chain = fit_chain(samples, known=known)
    if chain.clean and samples.n_samples >= _ENOUGH and (chain.inflation == 1.0).all():
        return Choice('chain', 'features of the dictionary explain no more of what the chain '
                      'left over than of noise', chain, None, [], ())
    energy, fits = fit_potential(samples, options)
    scale = np.sqrt(((samples.tau - chain.chain.torque(samples.q)) ** 2).mean(axis=0))
    scale = np.maximum(scale, floor(samples.tau))
    errors = np.array([_held_out(samples, test, chain, known, fits[0], options, scale)
                       for test in folds(samples.runs)])
    means = np.sqrt(errors.mean(axis=0))
    formulation = 'chain' if means[0] < means[1] else 'potential'
    other = 'potential' if formulation == 'chain' else 'chain'
    ours, theirs = means if formulation == 'chain' else means[::-1]
    why = (f'on held-out parts the {formulation} is right to {ours:.2f} and the {other} to '
           f'{theirs:.2f} times the noise')
    return Choice(formulation, why, chain, energy, fits, (float(means[0]), float(means[1])))


def _held_out(samples: JointSamples, test: BoolArray, chain: ChainFit,
              known: FloatArray | None, potential: SparseFit, options: SparseOptions,
              scale: FloatArray) -> tuple[float, float]:
    """Return the mean square errors of chain and potential on `test`, fitted without it."""
    train, unseen = samples.select(~test), samples.select(test)
    refitted = fit_chain(train, _WARM, chain.chain, known).chain.torque(unseen.q)
    energy, _ = fit_potential(train, replace(options, inflation=potential.inflation))
    predicted = _torque(energy, unseen.q)
    return (float((((unseen.tau - refitted) / scale) ** 2).mean()),
            float((((unseen.tau - predicted) / scale) ** 2).mean()))


def _torque(energy: Expansion, q: FloatArray) -> FloatArray:
    columns = EnergyDesign(q, np.ones(q.shape)).columns(energy.indices)
    return np.asarray((columns @ energy.weights).reshape(q.shape[1], -1).T)
