"""Selection of terms: rounds of moves on one joint, then exchanges of several terms."""

from __future__ import annotations

from itertools import combinations

from gravity_comp_ros.data.samples import BoolArray
from gravity_comp_ros.regression.alternatives import alternatives
from gravity_comp_ros.regression.gains import without_weak
from gravity_comp_ros.regression.noise import MAX_NOISES, noise_std
from gravity_comp_ros.regression.search import Search, Terms
from gravity_comp_ros.regression.term import is_consistent, Key, Term
import numpy as np


def run(search: Search, with_exchanges: bool = True) -> bool:
    """
    Select terms; return whether the selection has changed.

    :param with_exchanges: whether terms are exchanged between joints and selected again from
        other starts, which is only useful near the final estimate of the shared part.
    """
    rounds = noises = 0
    while rounds < search.options.max_rounds:
        search.tabu.clear()
        while rounds < search.options.max_rounds and search.improve():
            rounds += 1
        noises += 1
        if search.renew_noise() and noises < MAX_NOISES:
            continue
        # Exchanges take longer, and depend on the noise.
        if not with_exchanges or not _exchange(search):
            break
        rounds += 1
    return rounds > 0


def _exchange(search: Search) -> bool:
    """Exchange a term between joints, add two, replace two by one, or select a joint again."""
    moves = _between_joints, _pair, _unpair, _again
    return any(move(search) for move in moves)


def _between_joints(search: Search) -> bool:
    for term in search.terms:
        if term.key in search.forced:
            continue
        best = next(iter(alternatives(search, term)), None)
        minimum = search.posterior.log_evidence + search.options.significant
        if best is not None and best.log_evidence > minimum and search.accept(
                best.posterior.terms, 'exchange'):
            return True
    return False


def _pair(search: Search) -> bool:
    """
    Add two terms to a joint whose residual is not white, of which none helps alone.

    Friction that falls and then rises with speed is such a pair.
    """
    terms = search.terms
    for joint in np.flatnonzero(_coloured(search)):
        chosen: dict[Key, Term] = {}
        for _, term in search.ranking(search.posterior, search.pools[joint], terms, -np.inf):
            chosen.setdefault(term.key, term)
        for term in chosen.values():
            trial = search.solved((*terms, term))
            partner = next(search.ranking(trial, search.pools[joint], trial.terms), None)
            if partner is not None and search.accept(
                    _without_weak(search, (*trial.terms, partner[1])), 'pair'):
                return True
    return False


def _unpair(search: Search) -> bool:
    """
    Replace two terms of a joint by one.

    A term at a poor setting may have been corrected by another one.
    """
    for one, other in combinations(search.terms, 2):
        rest = tuple(t for t in search.terms if t not in (one, other))
        if (one.joint is None or one.joint != other.joint or not is_consistent(rest)
                or search.forced & {one.key, other.key}):
            continue
        without = search.posterior.without((one, other))
        best = next(search.ranking(without, search.pool_of(one), rest), None)
        if best is not None and search.accept(
                (*rest, search.refined(without, best[1])[0]), 'unpair'):
            return True
    return False


def _again(search: Search) -> bool:
    """
    Select the terms of a joint again from other starts: those that act at rest.

    All of them, where the residual is not white.
    """
    coloured = _coloured(search)
    for joint in range(search.design.n_joints):
        own = tuple(t for t in search.terms if t.joint == joint and t.columns.ndim == 2
                    and t.key not in search.forced)
        static = tuple(t for t in own if t.effect.is_static)
        # One that acts at rest was compared with each other one already.
        for dropped in dict.fromkeys((own, static) if coloured[joint] else (static,)):
            enough = 1 if coloured[joint] else 2
            if len(dropped) >= enough and _select_again(search, joint, dropped):
                return True
    return False


def _coloured(search: Search) -> BoolArray:
    """Return the joints (N,) whose residual is not white: a term may be missing."""
    return (noise_std(search.posterior, search.scale, search.options)
            > search.options.coloured * search.white_noise)


def _select_again(search: Search, joint: int, dropped: Terms) -> bool:
    """Replace terms of a joint by those that are selected from the best of a few starts."""
    rest = tuple(t for t in search.terms if t not in dropped)
    if not is_consistent(rest):
        return False
    without = search.posterior.without(dropped)
    starts: dict[str, Term] = {}
    for _, term in search.ranking(without, search.pools[joint], rest):
        if len(starts) >= search.options.starts:
            break
        starts.setdefault(term.name, term)
    for start in starts.values():
        # A setting that is refined while other terms are missing may be better or worse.
        for first in dict.fromkeys((start, search.refined(without, start)[0])):
            grown = _grown(search, (*rest, first), joint)
            if search.accept(_without_weak(search, grown), 'again'):
                return True
    return False


def _without_weak(search: Search, terms: Terms) -> Terms:
    """Return terms without the new ones that would be removed again."""
    return without_weak(search.solved(terms), lambda term: term not in search.terms,
                        search.options.min_gain).terms


def _grown(search: Search, terms: Terms, joint: int) -> Terms:
    """Return terms with those of a joint that raise the evidence, added one by one."""
    posterior, start = search.solved(terms), terms[-1]
    for _ in range(search.options.max_rounds):
        ranking = search.ranking(posterior, search.pools[joint], terms)
        gain, best = next(ranking, (-np.inf, None))
        if best is None or gain < search.options.min_gain:
            break
        best, _ = search.refined(posterior, best)
        trial = search.solved((*terms, best))
        if trial.log_evidence <= posterior.log_evidence:
            break
        posterior, terms = trial, trial.terms
    best, _ = search.refined(posterior.without((start,)), start)
    return tuple(best if term is start else term for term in terms)
