"""
Checks of a new model itself: it predicts samples that no fit has used, and is no echo.

It is compared with the model in use, and with the torque that the node published.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.evaluation.expected_residual import rms
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check, OPTIONS
from gravity_comp_ros.node.epoch import DELAYS, FULL_FIT_SAMPLES, REST_SPEED, Rows
from gravity_comp_ros.node.hypotheses import moving, moving_rms
from gravity_comp_ros.node.options import NODE
import numpy as np


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    A model's torque at samples (M, N), and its noise (N,), N·m.

    `nuisance` is the nuisance torque (M, N) that it was fitted with. It counts as explained, but
    not as gravity.
    """

    torque: FloatArray
    noise: FloatArray
    nuisance: FloatArray | float = 0.0

    def residual(self, samples: JointSamples) -> FloatArray:
        """Return the residual (M, N) in N·m."""
        return samples.tau - self.torque - self.nuisance


def held_out_rmse(error: FloatArray, rows: Rows) -> FloatArray:
    """Return the RMS (N,) in N·m of an error (M, N) over the held-out samples in motion."""
    return moving_rms(error[rows.held_out], rows.samples.qd[rows.held_out])


def compare(new: Prediction, old: Prediction | None, rows: Rows, has_more_samples: bool = False,
            margin: float = 0.0) -> tuple[list[Check], str]:
    """
    Return the checks that `new`, fitted to the training samples, predicts the others better.

    The compared figure is the RMSE relative to the smaller one of each joint, over all joints.
    With more samples `new` may be worse by `significant` standard deviations.

    :param old: the model in use; without one `new` is compared with a constant torque.
    :param margin: fraction by which the figure of `new` must be below that of `old`.
    :return: the checks, and the errors in one line.
    """
    samples, held_out, train = rows.samples, rows.held_out, ~rows.held_out
    is_first = old is None
    old = old or Prediction(samples.tau[train].mean(axis=0), new.noise)
    error_new, error_old = new.residual(samples), old.residual(samples)
    rmse_new, rmse_old = (held_out_rmse(error, rows) for error in (error_new, error_old))
    floor = OPTIONS.min_noise * max(1e-9, float(np.abs(samples.tau[train]).max()))
    level = np.maximum(np.minimum(rmse_new, rmse_old), floor)
    # In a few held-out seconds pose may explain much of the variance by coincidence.
    rmse = np.maximum(rmse_new, moving_rms(error_new[train], samples.qd[train]))
    noise = np.maximum(np.maximum(new.noise, old.noise), floor)
    rise = (rmse_new - OPTIONS.max_rise * rmse_old) / noise
    block = np.cumsum((np.diff(held_out, prepend=False) & held_out).astype(np.int64))[held_out]
    tolerance = -1e-9 if is_first or not has_more_samples else OPTIONS.significant * ratio_std(
        (error_new / level)[held_out], (error_old / level)[held_out], samples.qd[held_out], block)
    ratio = float(rms(rmse_new / level)) / max(float(rms(rmse_old / level)), 1e-30)
    worse = ', '.join(samples.names[j] for j in np.flatnonzero(rise > 1.0))
    reference, k = 'a constant torque' if is_first else 'the old model', int(
        np.argmax(np.maximum(rmse_new, rmse_old)))
    return [*_pose_explains(samples, train, new, rmse, is_first),
            Check(checks.NO_JOINT_WORSE, float(rise.max()), 1.0, text=f'worse on {worse}'),
            Check(checks.BETTER, ratio, 1.0 + tolerance - margin, text='not better')], (
        f'held-out RMSE {rms(rmse_new):.3g} N·m, {reference} {rms(rmse_old):.3g} N·m on '
        f'{held_out.sum()} samples; worst joint {samples.names[k]} {rmse_new[k]:.3g}, '
        f'{rmse_old[k]:.3g}')


def _pose_explains(samples: JointSamples, train: BoolArray, new: Prediction, rmse: FloatArray,
                   is_first: bool) -> Iterator[Check]:
    """
    Yield the check that pose explains the effort of a joint, by the RMSE (N,) of a model in N·m.

    Otherwise, in enough motion, the arm compensates gravity itself.
    """
    moves = int(train.sum()) >= FULL_FIT_SAMPLES and bool(
        (np.ptp(samples.q[train], axis=0) >= OPTIONS.min_span).any())
    if is_first or moves:
        spread = np.maximum((samples.tau - new.nuisance).std(axis=0), 1e-9)
        yield Check(checks.POSE_EXPLAINS, float((1.0 - (rmse / spread) ** 2).max()),
                    FactOptions().min_share, True, (
                        'the effort of no joint depends on pose: this arm seems to compensate '
                        'gravity itself, or its axes are all vertical; nothing to learn' if moves
                        else 'pose does not explain the effort yet'))


def ratio_std(new: FloatArray, old: FloatArray, qd: FloatArray, block: IntArray) -> float:
    """
    Return the standard deviation of the ratio of two RMS errors (M, N) on the same samples.

    It is that of their difference over blocks of consecutive samples, which are autocorrelated.

    :param block: number of the block of each sample (M,), from 1.
    """
    moves = moving(qd)
    squares = [(moves * error ** 2 / moves.sum(axis=0)).sum(axis=1) for error in (new, old)]
    change = np.bincount(block, squares[0] - squares[1])[1:]
    return float(np.sqrt(len(change)) * change.std(ddof=min(1, len(change) - 1))
                 / (2.0 * max(float(squares[1].sum()), 1e-30)))


def not_output(rows: Rows, new: Prediction, has_new_effects: bool = False) -> Check | None:
    """
    Return the check that the effort is not the torque that this node published.

    An arm that floats on the published torque and is guided by hand measures that torque,
    whatever its payload, and any model confirms itself. Friction is excluded: a position
    controller that adds friction torque may otherwise hide a light payload.

    :param has_new_effects: whether the new model has other effects; friction is then compared.
    :return: None where too little torque was published.
    """
    if rows.sent is None:
        return None
    known = np.isfinite(rows.sent).all(axis=(1, 2))
    if known.mean() < OPTIONS.min_published_share or known.sum() < 5 or float(
            np.sqrt((rows.sent[known] ** 2).mean())) < OPTIONS.min_published:
        return None
    torque, tau, qd = rows.sent[known], rows.samples.tau[known], rows.samples.qd[known]
    errors = [tau - new.torque[known], *(tau - torque[:, k] for k in range(len(DELAYS)))]
    if not has_new_effects:
        errors = [_without_friction(error, qd) for error in errors]
    spread = torque[:, 0].std(axis=0)
    counts = spread > OPTIONS.min_variation * float(spread.max(initial=0.0))
    model, *echoes = (error[:, counts] for error in errors)
    # A driver has any delay, so the torque is interpolated between those of the history. On a busy
    # machine the delay of some samples differs, so the sizes are medians.
    echo, delay = min(
        (_median_size((1.0 - share) * first + share * second), start + share * (end - start))
        for first, second, start, end in zip(echoes, echoes[1:], DELAYS, DELAYS[1:])
        for share in np.linspace(0.0, 1.0, NODE.delay_steps + 1))
    residual = _median_size(model)
    return Check(checks.NOT_OUTPUT, residual / max(echo, 1e-30), OPTIONS.max_echo, text=(
        'the effort is the torque that this node published '
        f'{1e3 * delay:.0f} ms before: median difference {echo:.3g} N·m, '
        f'residual of the new model {residual:.3g} N·m. Either the model in use is right already, '
        'or the arm floats on that torque and is guided by hand, which gives no new data: '
        'move it by its own controller'))


def _median_size(error: FloatArray) -> float:
    """Return the median over the samples of the RMS of an error (M, N) over the joints."""
    return float(np.sqrt(np.median((error ** 2).mean(axis=1))))


def _without_friction(residual: FloatArray, qd: FloatArray) -> FloatArray:
    """Return a residual (M, N) minus its least-squares Coulomb and viscous friction."""
    result = np.empty_like(residual)
    for n in range(residual.shape[1]):
        columns = np.column_stack([np.tanh(qd[:, n] / REST_SPEED), qd[:, n]])
        result[:, n] = residual[:, n] - columns @ lstsq(columns, residual[:, n])
    return result
