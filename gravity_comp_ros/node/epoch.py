"""An epoch: the time during which the arm carries one payload, and what was seen of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.sample_buffer import Coverage, SampleRing
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node.self_confirmation import Sent
import numpy as np

# Every fourth block of samples is held out from fits and judges them.
HELD_EVERY = 4
# Samples come more slowly than fits would, so wait until there is something new to learn.
GROWTH = 1.25


@dataclass(frozen=True)
class EpochOptions:
    """
    How an epoch collects and when it asks for a fit.

    `min_samples` to learn from are needed for a first fit if there is a model whose change it
    may be, `first_samples` if there is none, or once effort was broken. `block` samples in a row
    are held out together, because neighbours in time are not independent: a tenth of a second
    later the arm has hardly moved.

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


class Epoch:
    """
    Collects samples in two rings, to learn from and to judge by, and says when a fit is due.

    While it is open, a fit is due as soon as there is enough to learn from and to judge by,
    then each time a quarter more has come, and a last time when `full_samples` are there and
    every joint has moved over its range. That last fit closes it. A closed epoch goes on
    collecting, for a fit that somebody asks for.

    :param number: counts epochs from 0.
    :param names: joint names.
    :param is_open: False for an epoch that begins with a model that is known to fit.
    :param has_base: whether there is a model whose change may be fitted.
    """

    def __init__(self, number: int, names: Sequence[str], options: EpochOptions,
                 is_open: bool = True, has_base: bool = False) -> None:
        self.number = number
        self.is_open = is_open
        self.has_base = has_base
        self.is_suspect = False
        self.fits = 0
        # What happened to this epoch and must not be forgotten: a model that was refused or rolled
        # back, samples that were thrown away.
        self.note = ''
        self._names = tuple(names)
        self._options = options
        self.restart()

    def restart(self) -> None:
        """Forget all samples; the epoch stays open or closed."""
        self._taken = 0
        self._fitted_at = 0
        self._closing = False
        held = max(2, self._options.capacity // HELD_EVERY)
        self._train = SampleRing(self._names, max(2, self._options.capacity - held))
        self._held = SampleRing(self._names, held)
        self._sent: dict[float, FloatArray] = {}

    def distrust(self) -> None:
        """
        Forget all samples, since the effort was broken, and ask for more than usual.

        Few samples are no proof that it has healed: for a few seconds, a payload explains what a
        gain of one joint does.
        """
        self.restart()
        self.is_suspect = True

    def set_options(self, options: EpochOptions) -> None:
        """Use other thresholds from now on; the capacity stays."""
        self._options = options

    def offer(self, t: float, q: FloatArray, qd: FloatArray, tau: FloatArray,
              sent: FloatArray | None = None) -> None:
        """
        Take in a sample that passed the gate; the arguments are those of `SampleRing`.

        :param sent: torque that was published around it, `SentTorque.before`.
        """
        if sent is not None:
            self._sent[t] = sent
            while len(self._sent) > 2 * self._options.capacity:
                del self._sent[next(iter(self._sent))]
        block = self._taken // self._options.block
        ring = self._held if block % HELD_EVERY == HELD_EVERY - 1 else self._train
        ring.offer(t, q, qd, tau)
        self._taken += 1

    @property
    def n_train(self) -> int:
        return len(self._train)

    @property
    def n_held(self) -> int:
        return len(self._held)

    @property
    def n_samples(self) -> int:
        return self.n_train + self.n_held

    def train(self) -> JointSamples:
        """Return the samples to learn from."""
        return self._train.samples()

    def held(self) -> JointSamples:
        """Return the samples to judge by."""
        return self._held.samples()

    def sent(self) -> Sent | None:
        """Return the published torque of both sets, None if none was noted."""
        if not self._sent:
            return None
        none = np.full_like(next(iter(self._sent.values())), np.nan)
        return Sent(*(np.array([self._sent.get(float(t), none) for t in part.t])
                      for part in (self.train(), self.held())))

    def every(self) -> JointSamples:
        """Return all samples, in order of time."""
        both = concatenate((self.train(), self.held()))
        order = np.argsort(both.t, kind='stable')
        order = order[np.concatenate(([True], np.diff(both.t[order]) > 0))]
        return JointSamples.single_run(both.names, both.t[order], both.q[order],
                                       both.qd[order], both.tau[order], 'live')

    def coverage(self) -> Coverage:
        """Return what the samples to learn from cover."""
        return self._train.coverage()

    def lacking(self) -> tuple[str, ...]:
        """Return the joints that have not yet moved over `min_span`."""
        return self.coverage().joints_below_span(self._options.min_span)

    def can_fit(self) -> str | None:
        """Return None if there is enough for a fit, else what is missing."""
        if self.n_samples == 0:
            return 'no slow samples yet: move the arm slowly through its range'
        options = self._options
        certain = self.has_base and not self.is_suspect
        least = options.min_samples if certain else options.first_samples
        if self.n_train < least or self.n_held < options.block:
            why = ' after broken effort' if self.is_suspect else ''
            return (f'{self.n_train} samples to learn from and {self.n_held} to judge by; '
                    f'{least} and {options.block} are needed{why}: keep moving slowly')
        if len(self.lacking()) == len(self._train.names):
            return (f'no joint has moved over {self._options.min_span:g} rad: move the arm '
                    'slowly through its range')
        return None

    def fit_is_due(self) -> bool:
        """Return whether the open epoch asks for a fit now."""
        if not self.is_open or self._closing:
            return False
        grown = self.n_samples >= GROWTH * self._fitted_at
        return (grown or self._is_full()) and self.can_fit() is None

    def fit_started(self) -> None:
        """Note that a fit of all samples up to now has begun."""
        self._fitted_at = self.n_samples
        self._closing = self.is_open and self._is_full()

    def fit_ended(self, succeeded: bool) -> None:
        """Note that it ended; a fit that was lost to a fault does not close the epoch."""
        if succeeded:
            self.fits += 1
            if self._closing:
                self.is_open = False
        self._closing = False

    def describe(self) -> str:
        """Return the state of the epoch in words and numbers."""
        lacking = self.lacking()
        text = f'epoch {self.number} {"open" if self.is_open else "closed"}, ' \
            f'{self.n_samples} of {self._options.full_samples} samples ' \
            f'({self.n_held} held out)'
        if self.is_open and lacking:
            text += f', little range yet on {", ".join(lacking)}'
        return f'{text}; {self.note}' if self.note else text

    def _is_full(self) -> bool:
        return self.n_samples >= self._options.full_samples and not self.lacking()
