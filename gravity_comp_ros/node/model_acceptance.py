"""Comparison of a new model with the model in use on held-out samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.node.live_nuisance import moving_rms, rms
import numpy as np

# Share of a joint's effort variance explained by pose below which the effort has no gravity.
MIN_EXPLAINED = 0.2
# Minimum number of samples and range, rad, to conclude that the arm compensates gravity itself.
MIN_COMPENSATED_SAMPLES = 100
MIN_COMPENSATED_SPAN = 0.5


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    A model's torque at training and held-out samples (M, N), and its noise (N,), N·m.

    `nuisance_train` and `nuisance_held_out` are the nuisance torque that it was fitted with.
    They count as explained, but not as gravity.
    """

    train: FloatArray
    held_out: FloatArray
    noise: FloatArray
    nuisance_train: FloatArray | float = 0.0
    nuisance_held_out: FloatArray | float = 0.0


@dataclass(frozen=True)
class Verdict:
    """
    The result of a comparison; `reason` has its figures in one line.

    `broken` gives the reason why the effort is broken; empty if it is not.
    """

    better: bool
    compensated: bool
    reason: str
    broken: str = ''

    def refused(self, why: str) -> Verdict:
        """Return the same comparison for broken effort."""
        return replace(self.not_yet(why), broken=why)

    def not_yet(self, why: str) -> Verdict:
        """Return the same comparison with the model not accepted for this reason."""
        return replace(self, better=False, reason=f'{why} ({self.reason})')


def compare_models(new: Prediction, old: Prediction | None, train: JointSamples,
                   held_out: JointSamples, has_more_samples: bool = False,
                   margin: float = 0.0) -> Verdict:
    """
    Return whether `new`, fitted to `train`, predicts `held_out` better than `old`.

    The compared figure is the RMSE relative to each joint's noise, over all joints. In addition
    the RMSE of no joint may rise by more than a fifth plus its noise. Where the two figures are
    equal within statistical uncertainty, `new` is better only if it has more samples.

    :param old: the model in use; without one `new` is compared with a constant torque.
    :param has_more_samples: whether `new` was fitted to more samples than `old`.
    :param margin: fraction by which the figure of `new` must be below that of `old`.
    """
    error_new = held_out.tau - new.held_out - new.nuisance_held_out
    mean = train.tau.mean(axis=0)
    error_old = held_out.tau - (mean if old is None else old.held_out + old.nuisance_held_out)
    rmse_new, rmse_old = moving_rms(error_new, held_out.qd), moving_rms(error_old, held_out.qd)
    noise = np.maximum(new.noise, 1e-3 * max(1e-9, float(np.abs(train.tau).max())))
    if old is not None:
        noise = np.maximum(noise, old.noise)
    explained = _explained(new, train, held_out, rmse_new)
    figures = _figures(train.names, rmse_new, rmse_old, len(held_out), old is None)
    if _is_compensated(train, explained):
        return Verdict(False, True,
                       'the effort of no joint depends on pose: this arm seems to compensate '
                       'gravity itself, or its axes are all vertical; nothing to learn '
                       f'({figures})')
    worse = np.flatnonzero(rmse_new > 1.2 * rmse_old + noise)
    # Relative standard error of an RMSE of independent errors.
    tolerance = (1.0 / np.sqrt(2.0 * held_out.tau.size)
                 if has_more_samples and old is not None else 0.0)
    better = worse.size == 0 and bool(
        rms(rmse_new / noise) < (1.0 + tolerance - margin) * rms(rmse_old / noise))
    if better and old is None and (explained < MIN_EXPLAINED).all():
        return Verdict(False, False, f'pose does not explain the effort yet ({figures})')
    reason = figures
    if not better and worse.size:
        names = ', '.join(train.names[k] for k in worse)
        reason = f'worse on {names}: {figures}'
    return Verdict(better, False, reason)


def _explained(new: Prediction, train: JointSamples, held_out: JointSamples,
               rmse_held_out: FloatArray) -> FloatArray:
    """
    Return the share (N,) of the effort variance that pose explains, the smaller of both sets.

    In a few held-out seconds the share may be large by coincidence, hardly in both sets. The
    variance is that of all samples, because the arm may hardly move in the held-out ones.
    """
    spread = np.maximum(np.concatenate((train.tau - new.nuisance_train,
                                        held_out.tau - new.nuisance_held_out)).std(axis=0), 1e-9)
    residual = np.maximum(rmse_held_out, moving_rms(train.tau - new.train - new.nuisance_train,
                                                    train.qd))
    return np.asarray(1.0 - (residual / spread) ** 2)


def _is_compensated(train: JointSamples, explained: FloatArray) -> bool:
    if len(train) < MIN_COMPENSATED_SAMPLES or (explained >= MIN_EXPLAINED).any():
        return False
    return bool((np.ptp(train.q, axis=0) >= MIN_COMPENSATED_SPAN).any())


def _figures(names: tuple[str, ...], rmse_new: FloatArray, rmse_old: FloatArray, n_held_out: int,
             is_first: bool) -> str:
    k = int(np.argmax(np.maximum(rmse_new, rmse_old)))
    reference = 'a constant torque' if is_first else 'the old model'
    return (f'held-out RMSE {rms(rmse_new):.3g} N·m, {reference} {rms(rmse_old):.3g} N·m on '
            f'{n_held_out} samples; worst joint {names[k]} {rmse_new[k]:.3g}, {rmse_old[k]:.3g}')
