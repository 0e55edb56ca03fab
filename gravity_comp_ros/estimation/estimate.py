"""
Estimate of gravity, dynamics and effects: the choice of the shared part, and its regression.

Without a robot description the shared part is a chain whose axes are estimated; with one it is
the rigid-body regressor on the described axes. `potential` and `per_joint` are sparse sums of the
dictionary, whose support ADMM selects (Yu 2022, Eqs. 8-14). `auto` compares the potential with a
chain whose residual is neither white nor small.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.models.gravity_model import CHOICES, GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.sparse.dictionary import at_rest, n_features
from gravity_comp_ros.models.sparse.sparse_fit import fit_per_joint, fit_potential, SparseFit
from gravity_comp_ros.regression.common_settings import common_of, with_common
from gravity_comp_ros.regression.dictionary_columns import Energy, Torques
from gravity_comp_ros.regression.engine import regress, Regression
from gravity_comp_ros.regression.gains import gain_of
from gravity_comp_ros.regression.known_axes import KnownAxes
from gravity_comp_ros.regression.linear import with_common_terms
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.shared import Shared
from gravity_comp_ros.regression.start import start_axes
from gravity_comp_ros.regression.term import Key, Term
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
from gravity_comp_ros.regression.vertical import with_estimated_vertical
import numpy as np

MIN_SAMPLES = 10
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class FitOptions:
    """
    Options of a fit: the `formulation`, and how it is chosen.

    `auto` accepts a chain whose residual is white or small; otherwise it fits the potential too,
    and the held-out error decides. With a `geometry` the axes of the chain are known; the samples'
    joints must be in its order. `white` is the largest ratio of a joint's residual to its white
    noise at which the residual of a chain counts as white, `small` the share of the joint's torque
    scale below which it is accepted in any case. `better` is the share by which free axes, if they
    are more probable, must reduce the residual of some joint for described axes to be rejected.
    `max_potential_joints` is the number of joints up to which a potential is affordable.

    :raises OptionError: if the formulation is unknown, or does not use a geometry.
    """

    formulation: str = 'auto'
    geometry: Geometry | None = field(default=None, compare=False)
    engine: EngineOptions = EngineOptions()
    white: float = 2.0
    small: float = 0.01
    better: float = 0.3
    max_potential_joints: int = 9

    def __post_init__(self) -> None:
        if self.formulation not in CHOICES:
            raise OptionError(f'unknown formulation {self.formulation!r}; choose from '
                              f'{", ".join(CHOICES)}')
        if self.geometry is not None and self.formulation not in ('chain', 'auto'):
            raise OptionError(f'formulation {self.formulation} does not use known axes; choose '
                              f'chain or auto')

    def check_joints(self, samples: JointSamples) -> None:
        """
        Check that the known axes are those of the samples' joints, and their number.

        :raises ModelMismatchError: if they are of other joints, or in another order.
        :raises DataError: if they are too many for the dictionary.
        """
        if self.formulation in ('potential', 'per_joint'):
            n_features(samples.n_joints)
        if self.geometry is not None and self.geometry.joints != samples.names:
            raise ModelMismatchError(f'the known axes are of {", ".join(self.geometry.joints)}, '
                                     f'but the samples are of {", ".join(samples.names)}')

    def to_json(self) -> dict[str, Any]:
        """Return the options for a model's provenance."""
        return {'formulation': self.formulation, 'known_axes': self.geometry is not None}


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    A regression and how its shared part was chosen.

    `why` is the reason of the formulation, `held_out` held-out errors by formulation in multiples
    of the noise, empty without a comparison. `warning` is the reason why a description was
    rejected. `fits` are the solved L1 problems.
    """

    regression: Regression
    formulation: str
    why: str
    held_out: Mapping[str, float] = field(default_factory=dict)
    warning: str = ''
    fits: tuple[SparseFit, ...] = ()

    @property
    def geometry(self) -> Geometry | None:
        """Return the axes of a description, with mounting and zero angles as fitted."""
        shared = self.regression.shared
        return shared.geometry if isinstance(shared, KnownAxes) else None


def estimate(samples: JointSamples, options: FitOptions = FitOptions(),
             use: BoolArray | None = None, old: GravityModel | None = None,
             forced: frozenset[Key] = frozenset(), effects: Sequence[Effect] | None = None,
             progress: Progress | None = None) -> Estimate:
    """
    Return the estimate of samples.

    :param use: mask (M,) of the samples to fit; None for all.
    :param old: a model of the same joints as the start of the search; it is no constraint.
    :param forced: effects that stay in the model, as name and joint number.
    :param effects: the effects to test; all by default.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises ModelMismatchError: if the options have the axes of other joints.
    """
    _check(samples, use)
    options.check_joints(samples)
    problem = Problem.of(samples, use, options.engine)
    tested = tuple(all_effects().values()) if effects is None else tuple(effects)
    work = _Work(problem, options, old if old and old.joints == samples.names else None, forced,
                 tested, progress or (lambda word, share: None))
    work.report('fit', 0.0)
    result = work.result()
    work.report('fit', 1.0)
    return result


def estimate_again(earlier: Estimate, options: FitOptions, samples: JointSamples | None = None,
                   formulation: str = '') -> Estimate:
    """
    Return an estimate with the terms of an earlier one; no effect is searched for.

    :param samples: other samples, for which a chain begins at a new start of its axes; None for
        those of the earlier estimate.
    :param formulation: a sparse formulation; '' for that of the earlier estimate.
    :raises FitError: if there are too few samples, or no joint moves.
    """
    known, why = earlier.regression, 'it was requested' if formulation else earlier.why
    formulation = formulation or earlier.formulation
    if samples is not None:
        _check(samples, None)
    work = _Work(known.problem if samples is None else Problem.of(samples, None, options.engine),
                 options, None, frozenset(), tuple(all_effects().values()),
                 lambda word, share: None)
    if samples is not None:
        known = work.regress_terms(work.start_of(earlier.geometry), known.terms)
    if formulation == 'chain':
        return replace(earlier, regression=known)
    shared, fits = work.support(formulation, known)
    return Estimate(work.regress_terms(shared, known.terms), formulation, why, fits=fits)


@dataclass(frozen=True, eq=False)
class _Work:
    """Data that all ways to an estimate share."""

    problem: Problem
    options: FitOptions
    old: GravityModel | None
    forced: frozenset[Key]
    effects: tuple[Effect, ...]
    report: Progress

    def result(self) -> Estimate:
        """Return the requested formulation, or the one that predicts held-out samples best."""
        requested = self.options.formulation
        chain, warning = self._chain()
        why = self._accepted(chain) if requested == 'auto' else 'it was requested'
        if requested in ('potential', 'per_joint'):
            shared, fits = self.support(requested, chain)
            return Estimate(self._searched(shared, chain), requested, why, fits=fits)
        if why:
            return Estimate(chain, 'chain', why, warning=warning)
        shared, fits = self.support('potential', chain)
        potential = self.regress_terms(shared, chain.terms)
        error, of_chain = (each.held_out_ratio(chain.noise) for each in (potential, chain))
        if error < of_chain:
            # Its own effects are searched for only where it is better with those of the chain.
            potential = self._searched(shared, chain)
            error = potential.held_out_ratio(chain.noise)
        errors = {'chain': of_chain, 'potential': error}
        best, other = sorted(errors, key=lambda name: errors[name])
        why = (f'on held-out samples the error of the {best} is {errors[best]:.2f} and that of '
               f'the {other} {errors[other]:.2f} times the noise')
        if best == 'chain':
            return Estimate(chain, 'chain', why, errors, warning)
        return Estimate(potential, 'potential', why, errors, fits=fits)

    def _accepted(self, chain: Regression) -> str:
        """Return why a chain needs no comparison with the potential, '' if it does."""
        if self.problem.samples.n_joints > self.options.max_potential_joints:
            return (f'the potential is not tried on more than {self.options.max_potential_joints} '
                    f'joints')
        if chain.is_white(self.options.white):
            return 'the residual of the chain is white'
        if (chain.noise < self.options.small * self.problem.scale.torque).all():
            return 'the residual of the chain is small relative to gravity'
        return ''

    def _chain(self) -> tuple[Regression, str]:
        """Return the chain, on described axes unless free ones fit much better."""
        geometry = self.options.geometry
        if geometry is None:
            return self.regress(self._start()), ''
        known = self.regress(self._known(geometry))
        if known.is_white(self.options.white):
            return known, ''
        free = self.regress(self._start())
        worst = int(np.argmax(known.noise / free.noise))
        precision = known.posterior.precision
        if (free.noise[worst] >= (1.0 - self.options.better) * known.noise[worst]
                or free.evidence_at(precision) <= known.evidence_at(precision)):
            return known, ''
        return free, (
            f'the description is not used: with its axes the residual torque of '
            f'{self.problem.samples.names[worst]} is {known.noise[worst]:.2g} N·m, with free axes '
            f'{free.noise[worst]:.2g} N·m. Check that it is of this arm')

    def start_of(self, geometry: Geometry | None) -> Shared:
        """Return the start on the axes of a description, or without one."""
        return self._start() if geometry is None else self._known(geometry)

    def _known(self, geometry: Geometry) -> Shared:
        """Return described axes, with an estimated vertical if it is not the described one."""
        mounted = with_estimated_vertical(geometry, self.problem)
        return self._prepared(KnownAxes.of(mounted, mounted is geometry))

    def _start(self) -> Shared:
        if self.old is None or self.old.chain is None:
            return start_axes(self.problem, self.effects)
        known, n = _dynamics_of(self.old), self.old.n_joints
        if known is None or len(known) != 9 * n - 3:
            return self._prepared(UnknownLengths.of(self.old.chain))
        return UnknownLengths.of(self.old.chain, known[:3 * n - 3].reshape(n - 1, 3),
                                 known[3 * n - 3:].reshape(n, 6))

    def _prepared(self, shared: Shared) -> Shared:
        """Return a start with its moments, on which the columns of some effects depend."""
        return with_common_terms(self.problem, shared, self.effects).shared

    def support(self, formulation: str, known: Regression
                ) -> tuple[Shared, tuple[SparseFit, ...]]:
        """
        Return the columns of the dictionary that ADMM selects, and the solved problems.

        They are selected from the torque without the effects of motion of a known regression.
        """
        self.report('ADMM', 0.5)
        rows, fold = self.problem.means(known.torque_at_rest()), self.problem.rows.fold
        if formulation == 'potential':
            energy, fits = fit_potential(rows, fold)
            return Energy(energy), tuple(fits)
        torques, fits = fit_per_joint(rows, fold)
        return Torques(torques), tuple(fits)

    def _searched(self, shared: Shared, chain: Regression) -> Regression:
        """
        Return the regression on a support, from the effects of motion that the chain found.

        The static ones would explain what a chain misses of gravity.
        """
        return self.regress(shared, [t for t in chain.terms if not t.effect.is_static])

    def regress(self, shared: Shared, start: Iterable[Term] = ()) -> Regression:
        """
        Return the regression from a start, with the terms of the old model and the forced ones.

        A forced term that the search does not find is added at its best setting.
        """
        terms, is_selected = tuple(start), False
        if not terms and self.old is not None:
            terms = self._terms_of(shared, self.old)
            is_selected = bool(terms)
        present = self.forced & {term.key for term in terms}
        first = regress(self.problem, shared, self.effects, terms, present, is_selected)
        missing = self._forced_terms(first, self.forced - {term.key for term in first.terms})
        if not missing:
            return first
        return regress(self.problem, first.shared, self.effects, (*first.terms, *missing),
                       self.forced, is_selected=True)

    def _terms_of(self, shared: Shared, old: GravityModel) -> tuple[Term, ...]:
        """
        Return terms of the effects of a model that are tested and testable here.

        Effects that it predicts are kept where they are forced.
        """
        factory, names, terms = self.problem.factory(shared), self.problem.samples.names, []
        tested = {effect.name: effect for effect in self.effects}
        for one in (*old.applied.effects, *old.fitted.effects):
            effect = tested.get(one.name)
            if effect is None or effect.is_shared:
                continue
            joint = None if one.joint is None else names.index(one.joint)
            settings, _ = factory.settings(effect, joint)
            is_kept = (one.name, joint) in self.forced and old.applied.has(one.name, one.joint)
            if settings or is_kept:
                terms.append(factory.term(effect, joint, one.setting, max(len(settings), 1)))
        return tuple(terms)

    def regress_terms(self, shared: Shared, terms: Iterable[Term]) -> Regression:
        """
        Return the regression with given terms alone, with their columns on these samples.

        Those that are not testable here, such as a payload without a chain, are left out; forced
        ones are kept.
        """
        factory = self.problem.factory(shared)
        own = [factory.term(term.effect, term.joint, term.setting) for term in terms
               if term.key in self.forced or not factory.settings(term.effect, term.joint)[1]]
        keys = frozenset(term.key for term in own)
        own = [term for term in own if not term.parents or term.parents & keys]
        return regress(self.problem, shared, (), own, frozenset(term.key for term in own),
                       is_selected=True)

    def _forced_terms(self, first: Regression, keys: Iterable[Key]) -> tuple[Term, ...]:
        """Return terms of forced effects, where testable, at the settings of largest gain."""
        factory, known = self.problem.factory(first.shared), all_effects()
        terms: list[Term] = []
        for name, joint in sorted(keys, key=str):
            effect = known[name]
            settings, _ = factory.settings(effect, joint)
            if settings and not effect.is_shared:
                common = common_of((*first.terms, *terms), joint)
                terms.append(max((with_common(factory, factory.term(
                    effect, joint, setting, len(settings)), common) for setting in settings),
                    key=lambda term: gain_of(first.posterior, term)))
        return tuple(terms)


def _dynamics_of(model: GravityModel) -> FloatArray | None:
    """Return the parameters of motion of a model (`rigid_body_dynamics`); None without them."""
    for effect in (*model.applied.effects, *model.fitted.effects):
        if effect.name == DYNAMICS:
            return np.array([each.value for each in effect.coefficients.values()])
    return None


def _check(samples: JointSamples, use: BoolArray | None) -> None:
    part = samples if use is None else samples.select(use)
    if part.n_samples < MIN_SAMPLES:
        raise FitError(f'{part.n_samples} slow samples; a fit needs at least {MIN_SAMPLES}. '
                       f'Record longer or slower motion, or raise the speed limit of the gate')
    if at_rest(part.q).all():
        raise FitError('no joint moves; a fit needs poses that differ')
    if not part.tau.any():
        raise FitError('effort is 0 for every joint; check that the driver publishes it')
