"""Whether a new model may take the old one's place: both meet samples that neither has seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.node.live_friction import moving_rms, rms
import numpy as np

# Below this part of a joint's effort variance explained by pose there is no gravity in it.
EXPLAINED = 0.2
# To say "this arm compensates gravity itself" takes more than to say "not yet".
CERTAIN_SAMPLES = 100
CERTAIN_SPAN = 0.5


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    A model's torque of the samples to learn from and to judge by, and its noise (N,), N·m.

    `beside_train` and `beside_held` are the friction and offset that it was fitted with. They
    count as explained, but not as gravity.
    """

    train: FloatArray
    held: FloatArray
    noise: FloatArray
    beside_train: FloatArray | float = 0.0
    beside_held: FloatArray | float = 0.0


@dataclass(frozen=True)
class Verdict:
    """
    The outcome of a comparison; `reason` tells its figures in one line.

    `broken` is why the effort cannot be what the drives supply, empty for a model that is judged
    by its figures alone.
    """

    better: bool
    compensated: bool
    reason: str
    broken: str = ''

    def refused(self, why: str) -> Verdict:
        """Return the same comparison, of effort that is broken."""
        return replace(self.not_yet(why), broken=why)

    def not_yet(self, why: str) -> Verdict:
        """Return the same comparison, the model not taken for this reason."""
        return replace(self, better=False, reason=f'{why} ({self.reason})')


def judge(new: Prediction, old: Prediction | None, train: JointSamples, held: JointSamples,
          knows_more: bool = False, margin: float = 0.0) -> Verdict:
    """
    Return whether `new`, learned from `train`, predicts `held` better than `old` does.

    The figure compared is the RMSE relative to each joint's noise, over all joints; besides,
    no joint may get worse by more than a fifth and its noise. Where the two figures are equal
    within what chance does to them, `new` is taken only if it knows more.

    :param old: the model in use; without one, a constant torque is the rival.
    :param knows_more: whether `new` was learned from more samples than `old`.
    :param margin: share by which the figure of `new` must be below that of `old`.
    """
    error_new = held.tau - new.held - new.beside_held
    mean = train.tau.mean(axis=0)
    error_old = held.tau - (mean if old is None else old.held + old.beside_held)
    rmse_new, rmse_old = moving_rms(error_new, held.qd), moving_rms(error_old, held.qd)
    noise = np.maximum(new.noise, 1e-3 * max(1e-9, float(np.abs(train.tau).max())))
    if old is not None:
        noise = np.maximum(noise, old.noise)
    # Of both sets the smaller share: in a few held-out seconds chance explains much, but hardly
    # the same that it explains in training. Variance is that of all samples, because within a
    # held-out second the arm may hardly have moved.
    spread = np.maximum(np.concatenate((train.tau - new.beside_train,
                                        held.tau - new.beside_held)).std(axis=0), 1e-9)
    residual = np.maximum(rmse_new, moving_rms(train.tau - new.train - new.beside_train,
                                               train.qd))
    explained = 1.0 - (residual / spread) ** 2
    figures = _figures(train.names, rmse_new, rmse_old, len(held), old is None)
    compensated = _is_compensated(train, explained)
    if compensated:
        return Verdict(False, True,
                       'the effort of no joint depends on pose: this arm seems to compensate '
                       'gravity itself, or its axes are all vertical; nothing to learn '
                       f'({figures})')
    worse = np.flatnonzero(rmse_new > 1.2 * rmse_old + noise)
    # The standard error of an RMSE of independent errors, as a part of it.
    chance = 1.0 / np.sqrt(2.0 * held.tau.size) if knows_more and old is not None else 0.0
    better = worse.size == 0 and bool(
        rms(rmse_new / noise) < (1.0 + chance - margin) * rms(rmse_old / noise))
    if better and old is None and (explained < EXPLAINED).all():
        return Verdict(False, False, f'pose does not explain the effort yet ({figures})')
    reason = figures
    if not better and worse.size:
        names = ', '.join(train.names[k] for k in worse)
        reason = f'worse on {names}: {figures}'
    return Verdict(better, False, reason)


def _is_compensated(train: JointSamples, explained: FloatArray) -> bool:
    if len(train) < CERTAIN_SAMPLES or (explained >= EXPLAINED).any():
        return False
    return bool((np.ptp(train.q, axis=0) >= CERTAIN_SPAN).any())


def _figures(names: tuple[str, ...], rmse_new: FloatArray, rmse_old: FloatArray, n_held: int,
             is_first: bool) -> str:
    k = int(np.argmax(np.maximum(rmse_new, rmse_old)))
    rival = 'a constant torque' if is_first else 'the old model'
    return (f'held-out RMSE {rms(rmse_new):.3g} N·m, {rival} {rms(rmse_old):.3g} N·m on '
            f'{n_held} samples; worst joint {names[k]} {rmse_new[k]:.3g}, {rmse_old[k]:.3g}')
