"""
Samples on their way from a message to a fit, and the epoch that collects them.

An epoch is the period during which the arm carries one payload.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.differentiation import acceleration_at, WINDOW
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.evaluation.external_torque import ExternalTorqueOptions
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np

# Speed below which a joint is at rest for its friction, rad/s.
REST_SPEED = ExternalTorqueOptions().rest_speed
# Time over which the messages around a sample are averaged, s: that of a row of the regression.
MEAN_OVER = EngineOptions().row_seconds
# Minimum number of training samples of a full fit, and of an epoch that starts again after faulty
# effort: samples after a repair must not be fitted together with faulty ones. With fewer a full
# fit overfits and extrapolates badly (the change of an old model requires a fraction of them), and
# more samples may resolve a refusal.
FULL_FIT_SAMPLES = FactOptions().min_samples


@dataclass(frozen=True, eq=False)
class Rows:
    """
    The samples (M) of an epoch in order of time, with one run for each start of the clock.

    `held_out` (M,) marks those that no fit uses. `sent` (M, 2, N) has the torques that were
    published before each (`SlowSample`); None without such torques.
    """

    samples: JointSamples
    held_out: BoolArray
    sent: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def train(self) -> JointSamples:
        """The samples to fit."""
        return self.samples.select(~self.held_out)

    def select(self, keep: BoolArray) -> Rows:
        """Return the rows that a mask (M,) keeps."""
        return Rows(self.samples.select(keep), self.held_out[keep],
                    None if self.sent is None else self.sent[keep])


@dataclass(frozen=True, eq=False)
class SlowSample:
    """
    A reading that passed the gate.

    `sent` (2, N) has the torques in N·m that were published last before it, and before
    `NODE.max_delay` s earlier; NaN for none. `qdd` (N,) is the acceleration in rad/s^2 of the
    messages around it, None for a single message; `is_resolved` is false if their rate does not
    resolve quick starts and stops. `run` is the number of its run in an epoch.
    """

    reading: CompleteReading
    sent: FloatArray
    qdd: FloatArray | None = None
    is_resolved: bool = False
    run: int = 0
    is_held_out: bool = False


class DelayedSamples:
    """
    Slow samples that wait for half a window of later messages.

    An acceleration from earlier messages alone would be that of a moment before the sample. Where
    no joint reverses, a sample is the mean of the messages around it: gravity, friction and
    inertia of the mean motion are then the mean torque, with less noise than that of one message.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[CompleteReading, FloatArray]] = deque()
        # Messages, each with the torque published last before it.
        self._recent: deque[tuple[CompleteReading, FloatArray]] = deque()

    def restart(self) -> None:
        """Drop all samples: the clock or the payload has changed."""
        self._waiting.clear()
        self._recent.clear()

    def add(self, reading: CompleteReading, sent: FloatArray, is_slow: bool) -> None:
        """Add a message with the torque (N,) published last before it, NaN for none."""
        self._recent.append((reading, sent))
        # Messages after a sample arrive while it waits for them.
        while self._recent[0][0].t < reading.t - 1.5 * WINDOW:
            self._recent.popleft()
        if is_slow:
            earlier = next(torque for other, torque in self._recent
                           if other.t >= reading.t - NODE.max_delay)
            self._waiting.append((reading, np.array([sent, earlier])))

    def due(self, t: float) -> list[SlowSample]:
        """Return the samples that are old enough at time t in s, with their accelerations."""
        ready = []
        while self._waiting and t >= self._waiting[0][0].t + 0.5 * WINDOW:
            reading, sent = self._waiting.popleft()
            times, q, qd, tau = (np.array(values) for values in zip(*(
                (other.t, other.q, other.qd, other.tau) for other, _ in self._recent)))
            qdd = acceleration_at(reading.t, times, qd)
            is_resolved = qdd is not None
            if qdd is None and len(times) > 1:
                qdd = (qd[-1] - qd[0]) / (times[-1] - times[0])
            near = np.abs(times - reading.t) <= 0.5 * MEAN_OVER + 1e-6
            reverses = (qd[near] > REST_SPEED).any(axis=0) & (qd[near] < -REST_SPEED).any(axis=0)
            if near.any() and not reverses.any():
                reading = CompleteReading(
                    float(times[near].mean()), q[near].mean(axis=0), qd[near].mean(axis=0),
                    tau[near].mean(axis=0), reading.new_run)
            ready.append(SlowSample(reading, sent, qdd, is_resolved))
        return ready


def rows_of(names: Sequence[str], slow: Sequence[SlowSample]) -> Rows:
    """
    Return samples, at least one, with the sent torques; it takes milliseconds.

    They have accelerations if most are resolved; others are then 0, as at isolated samples.
    """
    t, q, qd, tau = (np.array(values) for values in zip(*(
        (each.reading.t, each.reading.q, each.reading.qd, each.reading.tau) for each in slow)))
    starts, numbers = np.unique([each.run for each in slow], return_inverse=True)
    known = [each.qdd is not None and each.is_resolved for each in slow]
    qdd = np.array([each.qdd if is_known else np.zeros(len(names))
                    for each, is_known in zip(slow, known)])
    samples = JointSamples(tuple(names), t, q, qd, tau, numbers.reshape(-1),
                           tuple(f'live {run}' for run in starts), (0.0,) * len(starts),
                           qdd if np.mean(known) >= NODE.min_known else None)
    return Rows(samples, np.array([each.is_held_out for each in slow]),
                np.array([each.sent for each in slow]))


def thinned(samples: Sequence[SlowSample], count: int) -> list[SlowSample]:
    """
    Return at most `count` samples of diverse poses: the newest one of each cell.

    A cell has a range of positions and velocities, as samples of one pose with opposite directions
    differ by friction; held-out samples have their own. Its edge doubles until the samples fit: an
    arm that repeats a motion replaces the samples of this motion, and earlier ones stay.
    """
    place = np.hstack((np.array([each.reading.q for each in samples]),
                       NODE.cell_time * np.array([each.reading.qd for each in samples])))
    held_out, edge = np.array([[each.is_held_out] for each in samples]), NODE.min_motion
    newest, row = dict[object, int](), np.dtype((np.void, 8 * (place.shape[1] + 1)))
    while not newest or len(newest) > count:
        # Small values of both signs share a cell at every size: 0 is a third from its border.
        cells = np.hstack((held_out, np.floor(place / edge + 1.0 / 3.0))).astype(np.int64)
        newest, edge = dict(zip(cells.view(row).ravel().tolist(), range(len(cells)))), 2.0 * edge
    return [samples[k] for k in sorted(newest.values())]


class Epoch:
    """
    Collects samples, some of them held out, and determines when a fit is due.

    In an open epoch a fit is due as soon as there are enough samples of both kinds, again after
    each growth by a quarter, and a last time with `full_samples` and range on every joint. The
    last fit closes the epoch. A closed epoch collects samples for fits on request.

    `base` is the model in use as the epoch begins, whose change may be fitted. An epoch that
    begins with a model of its payload is closed.
    """

    def __init__(self, number: int, names: Sequence[str], settings: Parameters,
                 base: GravityModel | None = None, is_open: bool = True) -> None:
        self.number = number
        self.base = base
        self.is_open = is_open
        self.settings = settings
        self.names = tuple(names)
        self.restart()

    def restart(self, after_fault: bool = False) -> None:
        """
        Drop all samples; the epoch stays open or closed.

        After a fault of the effort the next fit needs those of a full one: in few samples a
        payload explains a wrong gain.
        """
        self._after_fault = after_fault
        self._offered = self._fitted_at = 0
        # Whether the last fit was one of all samples that the epoch requires.
        self._was_full = False
        self._samples: list[SlowSample] = []
        self._last, self._run = -np.inf, 0
        # Smallest and largest positions of all samples since the restart, rad.
        self._low, self._high = (np.full(len(self.names), edge) for edge in (np.inf, -np.inf))

    def offer(self, sample: SlowSample) -> None:
        """Add a sample that passed the gate; a time that does not increase starts a new run."""
        block, new = self._offered // NODE.block, sample.reading
        is_held_out = block % NODE.held_out_every == NODE.held_out_every - 1
        self._run, self._last = self._run + (new.t <= self._last), new.t
        if len(self) == NODE.capacity:
            self._samples = thinned(self._samples, NODE.capacity * 3 // 4)
        self._samples.append(replace(sample, run=self._run, is_held_out=is_held_out))
        self._offered += 1
        self._low, self._high = np.minimum(self._low, new.q), np.maximum(self._high, new.q)

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def n_held_out(self) -> int:
        return sum(sample.is_held_out for sample in self._samples)

    def samples(self) -> list[SlowSample]:
        """Return the samples, for `rows_of` in another thread."""
        return self._samples.copy()

    def span(self) -> FloatArray:
        """Return the range of every joint in this epoch, (N,) in rad; 0 without samples."""
        return np.maximum(self._high - self._low, 0.0)

    def short_of_range(self) -> tuple[str, ...]:
        """Return the joints that have not yet moved over `NODE.min_range`."""
        return tuple(name for name, span in zip(self.names, self.span()) if span < NODE.min_range)

    def missing_for_fit(self) -> str | None:
        """Return the missing data of a fit, None if it has enough."""
        if len(self) == 0:
            return 'no slow samples yet: move the arm slowly through its range'
        n_held_out, minimum = self.n_held_out, FULL_FIT_SAMPLES
        n_train = len(self) - n_held_out
        if self.base is not None and self.base.energy is not None and not self._after_fault:
            minimum = self.settings.min_samples
        if n_train < minimum or n_held_out < NODE.block:
            why = ' after broken effort' if self._after_fault else ''
            return (f'{n_train} training and {n_held_out} held-out samples; '
                    f'{minimum} and {NODE.block} are needed{why}: keep moving slowly')
        if len(self.short_of_range()) == len(self.names):
            return (f'no joint has moved over {NODE.min_range:g} rad: move the arm slowly '
                    'through its range')
        return None

    def fit_is_due(self) -> bool:
        """Return whether the open epoch requires a fit now."""
        if not self.is_open:
            return False
        # A fit that failed is repeated with more samples only: it may fail each time.
        is_due = self._offered >= NODE.growth * self._fitted_at or (
            self._is_full() and not self._was_full)
        return is_due and self.missing_for_fit() is None

    def fit_started(self) -> None:
        """Record the start of a fit of all samples up to now."""
        self._fitted_at, self._was_full = self._offered, self._is_full()

    def fit_succeeded(self) -> None:
        """Close the epoch if the last fit was one of all samples that it requires."""
        self.is_open = self.is_open and not self._was_full

    def describe(self) -> str:
        """Return the state of the epoch as text."""
        missing = self.short_of_range() if self.is_open else ()
        text = f', too little range on {", ".join(missing)}' if missing else ''
        return (f'epoch {self.number} {"open" if self.is_open else "closed"}, {len(self)} of '
                f'{self.settings.full_samples} samples ({self.n_held_out} held out){text}')

    def _is_full(self) -> bool:
        return len(self) >= self.settings.full_samples and not self.short_of_range()
