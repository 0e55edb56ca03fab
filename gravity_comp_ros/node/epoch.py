"""Epoch: the period during which the arm carries one payload, and its samples."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

from gravity_comp_ros.data.runs import in_one_run
from gravity_comp_ros.data.sample_buffer import Coverage, SampleRing
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node.sent_torque import SentTorque
import numpy as np

# One block of samples in this many is held out from fits.
HELD_OUT_EVERY = 4
# Growth of the number of samples after which the next fit is due.
GROWTH = 1.25


@dataclass(frozen=True)
class EpochOptions:
    """
    Sizes of an epoch.

    The first fit requires `min_samples` training samples where the change of a model can be
    fitted, else, and after broken effort, `first_samples`. `block` consecutive samples are held
    out together, because consecutive samples are autocorrelated.

    :raises OptionError: if the numbers contradict each other.
    """

    capacity: int = 1500
    min_samples: int = 30
    first_samples: int = 100
    full_samples: int = 500
    min_span: float = 0.2
    block: int = 5

    def __post_init__(self) -> None:
        if self.block < 1 or self.min_samples < 1:
            raise OptionError('epoch: block and min_samples must be at least 1')
        if not max(self.min_samples, self.first_samples) <= self.full_samples <= self.capacity:
            raise OptionError(
                f'epoch: min_samples {self.min_samples} and first_samples '
                f'{self.first_samples} must not be above full_samples {self.full_samples}, nor '
                f'that above capacity {self.capacity}')


class Snapshot:
    """The samples of an epoch at one time; its methods take milliseconds."""

    def __init__(self, train: SampleRing, held_out: SampleRing,
                 sent: dict[float, FloatArray]) -> None:
        self._train, self._held_out, self._sent = train, held_out, sent

    def train(self) -> JointSamples:
        """Return the training samples."""
        return self._train.samples()

    def held_out(self) -> JointSamples:
        """Return the held-out samples."""
        return self._held_out.samples()

    def all(self) -> JointSamples:
        """Return training and held-out samples in order of time."""
        both = concatenate((self.train(), self.held_out()))
        order = np.argsort(both.t, kind='stable')
        order = order[np.concatenate(([True], np.diff(both.t[order]) > 0))]
        return in_one_run(both, order)

    def sent(self) -> SentTorque | None:
        """Return the torque published before the samples of both sets, None without any."""
        if not self._sent:
            return None
        none = np.full_like(next(iter(self._sent.values())), np.nan)
        return SentTorque(*(np.array([self._sent.get(float(t), none) for t in part.t])
                            for part in (self.train(), self.held_out())))


class Epoch:
    """
    Collects training and held-out samples, and determines when a fit is due.

    In an open epoch a fit is due as soon as there are enough samples of both kinds, again after
    each growth by a quarter, and a last time with `full_samples` and range on every joint. The
    last fit closes the epoch. A closed epoch collects samples for fits on request.

    :param number: number of the epoch, from 0.
    :param names: joint names.
    :param is_open: False for an epoch that begins with a model of its payload.
    :param has_base: whether there is a model whose change can be fitted.
    """

    def __init__(self, number: int, names: Sequence[str], options: EpochOptions,
                 is_open: bool = True, has_base: bool = False) -> None:
        self.number = number
        self.is_open = is_open
        self.has_base = has_base
        self.had_broken_effort = False
        self.fits = 0
        # Last event of this epoch: a model refused or rolled back, samples dropped.
        self.note = ''
        self._names = tuple(names)
        self._options = options
        self.restart()

    def restart(self) -> None:
        """Drop all samples; the epoch stays open or closed."""
        self._offered = 0
        self._fitted_at = 0
        self._closing = False
        held_out = max(2, self._options.capacity // HELD_OUT_EVERY)
        self._train = SampleRing(self._names, max(2, self._options.capacity - held_out))
        self._held_out = SampleRing(self._names, held_out)
        self._sent: dict[float, FloatArray] = {}

    def restart_after_broken_effort(self) -> None:
        """
        Drop all samples; the next fit requires `first_samples`.

        In a few seconds of motion a payload explains a wrong gain of one joint.
        """
        self.restart()
        self.had_broken_effort = True

    def set_options(self, options: EpochOptions) -> None:
        """Use other thresholds from now on; the capacity stays."""
        self._options = options

    def offer(self, t: float, q: FloatArray, qd: FloatArray, tau: FloatArray,
              qdd: FloatArray | None = None, sent: FloatArray | None = None) -> None:
        """
        Add a sample that passed the gate; the arguments are those of `SampleRing`.

        :param sent: torque published before it, `SentTorqueHistory.before`.
        """
        if sent is not None:
            self._sent[t] = sent
            while len(self._sent) > 2 * self._options.capacity:
                del self._sent[next(iter(self._sent))]
        block = self._offered // self._options.block
        ring = self._held_out if block % HELD_OUT_EVERY == HELD_OUT_EVERY - 1 else self._train
        ring.offer(t, q, qd, tau, qdd)
        self._offered += 1

    @property
    def n_train(self) -> int:
        return len(self._train)

    @property
    def n_held_out(self) -> int:
        return len(self._held_out)

    @property
    def n_samples(self) -> int:
        return self.n_train + self.n_held_out

    def train(self) -> JointSamples:
        """Return the training samples."""
        return self._train.samples()

    def held_out(self) -> JointSamples:
        """Return the held-out samples."""
        return self._held_out.samples()

    def all_samples(self) -> JointSamples:
        """Return training and held-out samples in order of time."""
        return self.snapshot().all()

    def snapshot(self) -> Snapshot:
        """Return a copy of the samples as they are, for another thread; it takes 0.1 ms."""
        return Snapshot(deepcopy(self._train), deepcopy(self._held_out), dict(self._sent))

    def coverage(self) -> Coverage:
        """Return the coverage of the training samples."""
        return self._train.coverage()

    def short_of_range(self) -> tuple[str, ...]:
        """Return the joints that have not yet moved over `min_span`."""
        return self.coverage().joints_below_span(self._options.min_span)

    def missing_for_fit(self) -> str | None:
        """Return the missing data of a fit, None if it has enough."""
        if self.n_samples == 0:
            return 'no slow samples yet: move the arm slowly through its range'
        options = self._options
        few_suffice = self.has_base and not self.had_broken_effort
        minimum = options.min_samples if few_suffice else options.first_samples
        if self.n_train < minimum or self.n_held_out < options.block:
            why = ' after broken effort' if self.had_broken_effort else ''
            return (f'{self.n_train} training and {self.n_held_out} held-out samples; '
                    f'{minimum} and {options.block} are needed{why}: keep moving slowly')
        if len(self.short_of_range()) == len(self._train.names):
            return (f'no joint has moved over {self._options.min_span:g} rad: move the arm '
                    'slowly through its range')
        return None

    def fit_is_due(self) -> bool:
        """Return whether the open epoch requires a fit now."""
        if not self.is_open or self._closing:
            return False
        grown = self.n_samples >= GROWTH * self._fitted_at
        return (grown or self._is_full()) and self.missing_for_fit() is None

    def fit_started(self) -> None:
        """Record the start of a fit of all samples up to now."""
        self._fitted_at = self.n_samples
        self._closing = self.is_open and self._is_full()

    def fit_ended(self, succeeded: bool) -> None:
        """Record the end of a fit; a failed fit does not close the epoch."""
        if succeeded:
            self.fits += 1
            if self._closing:
                self.is_open = False
        self._closing = False

    def describe(self) -> str:
        """Return the state of the epoch as text."""
        missing = self.short_of_range()
        text = f'epoch {self.number} {"open" if self.is_open else "closed"}, ' \
            f'{self.n_samples} of {self._options.full_samples} samples ' \
            f'({self.n_held_out} held out)'
        if self.is_open and missing:
            text += f', too little range on {", ".join(missing)}'
        return f'{text}; {self.note}' if self.note else text

    def _is_full(self) -> bool:
        return self.n_samples >= self._options.full_samples and not self.short_of_range()
