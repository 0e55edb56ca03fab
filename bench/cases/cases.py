"""Recordings with a hidden effect in them, and what a diagnosis of them ought to say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from zlib import crc32

from bench.cases.degraded import Degradation
from bench.cases.generated import generated_arm
from bench.cases.pauses import Pause, with_pauses
from bench.cases.sensors import measured, SensorOptions
from bench.cases.six_axis import six_axis
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm, iiwa7
from gravity_comp_ros.simulation.hidden import noise_levels
from gravity_comp_ros.simulation.motions import Motion, multisine, MultisineOptions, sample
from gravity_comp_ros.simulation.synthesise import Disturbance, synthesise, SynthesisOptions
import numpy as np

Pair = tuple[str, int | None]
"""An effect and its joint, counted from 0; None for the arm as a whole, or any joint of it."""

ARMS: dict[str, Callable[[], Arm]] = {
    'iiwa7': iiwa7, 'six_axis': six_axis,
    'right_seven': partial(generated_arm, 21, 7, True),
    'right_six': partial(generated_arm, 24, 6, True), 'any_six': partial(generated_arm, 28, 6)}
VERDICTS = ('found', 'nothing', 'unexplained', 'untestable', 'weak')

# A delay or a bristle wants finer steps than a recording has.
_SIMULATION_RATE = 200.0


@dataclass(frozen=True)
class Truth:
    """
    One thing to be found: an effect on a joint, or one of its named `ties` instead.

    `values` are the coefficients that the effect should have, in their order and in `unit`,
    where the simulation's law and the library's agree on their meaning; empty where they do
    not.
    """

    effect: str
    joint: int | None
    ties: tuple[Pair, ...] = ()
    values: tuple[float, ...] = ()
    unit: str = ''

    @property
    def answers(self) -> frozenset[Pair]:
        return frozenset(((self.effect, self.joint), *self.ties))


@dataclass(frozen=True)
class Case:
    """
    A hidden-effect case on an arm of `ARMS`.

    `disturbances` act in every run, and those of `in_run` in the run of their number alone.
    `verdict` says what a right diagnosis ends with: 'found' (every one of `truths`),
    'nothing', 'unexplained' or 'untestable' (on the truths' joints), or 'weak' (too small to
    ask for, but no false finding either). `allowed` are effects that are there as well, or
    follow from the truth, without being asked for.

    `correlated` is the part of the torque noise's variance that is correlated over
    `correlation` s, `max_speed` in rad/s that of the fastest run. `one_way` is a joint that
    moves in one direction only, and never rests. With a `pause` in s between runs, their stamps
    are on one clock. `degraded` is what happens to messages on their way to the recording.

    :raises OptionError: if arm or verdict is unknown.
    """

    name: str
    arm: str
    verdict: str = 'found'
    disturbances: tuple[Disturbance, ...] = ()
    truths: tuple[Truth, ...] = ()
    allowed: frozenset[Pair] = frozenset()
    in_run: tuple[tuple[int, Disturbance], ...] = ()
    runs: int = 5
    duration: float = 150.0
    max_speed: float = 0.35
    correlated: float = 0.3
    correlation: float = 0.5
    one_way: int | None = None
    pause: float | None = None
    degraded: tuple[Degradation, ...] = ()

    def __post_init__(self) -> None:
        if self.arm not in ARMS:
            raise OptionError(f'case {self.name}: no arm {self.arm}; there are {", ".join(ARMS)}')
        if self.verdict not in VERDICTS:
            raise OptionError(f'case {self.name}: verdict {self.verdict} is none of '
                              f'{", ".join(VERDICTS)}')
        if self.runs < 1 or not self.duration > 0:
            raise OptionError(f'case {self.name}: needs at least one run longer than 0 s')

    @property
    def expected(self) -> frozenset[Pair]:
        """Return every pair that names a truth rightly."""
        return frozenset(pair for truth in self.truths for pair in truth.answers)


def undisturbed(case: Case) -> Case:
    """Return the case with the same motion and noise from the same seed, and nothing hidden."""
    return replace(case, disturbances=(), in_run=(), truths=(), verdict='nothing')


def recordings(case: Case, seed: int = 0, rate: float = 50.0) -> JointSamples:
    """
    Return the case's runs as the arm's sensors would record them at `rate` Hz.

    The motion is a multisine of a seed of its own in every run, with pauses; the torque is
    that of the moving rigid arm. The same case and seed give the same samples.
    """
    arm = ARMS[case.arm]()
    streams = np.random.SeedSequence([crc32(f'{case.arm} {case.name}'.encode()), seed])
    noisy = SensorOptions(noise_levels(arm), case.correlated, case.correlation)
    runs = []
    for number, stream in enumerate(streams.spawn(case.runs)):
        moving, hidden, sensing = stream.spawn(3)
        every = max(1, int(np.ceil(_SIMULATION_RATE / rate)))
        motion = run_motion(case, arm, number, rate * every, np.random.default_rng(moving))
        acting = case.disturbances + tuple(d for run, d in case.in_run if run == number)
        options = SynthesisOptions(seed=int(hidden.generate_state(1)[0]), disturbances=acting)
        run = synthesise(arm, motion, options, f'{case.name} {number + 1}')
        run = run.select(np.arange(0, len(run), every))
        runs.append(_received(case, number, measured(run, noisy, np.random.default_rng(sensing)),
                              np.random.default_rng([number, *sensing.generate_state(2)])))
    return concatenate(runs)


def _received(case: Case, number: int, run: JointSamples,
              rng: np.random.Generator) -> JointSamples:
    """Return a run as it is recorded, with its start on a clock if there is one."""
    for degradation in case.degraded:
        run = degradation.apply(run, rng)
    if case.pause is None:
        return run
    return replace(run, starts=(number * (case.duration + case.pause),))


def run_motion(case: Case, arm: Arm, number: int, rate: float,
               rng: np.random.Generator) -> Motion:
    """Return the motion of one run: each run has another speed, the first the highest."""
    speed = case.max_speed * (1.0 if number == 0 else rng.uniform(0.4, 1.0))
    options = MultisineOptions(max_speed=speed)
    motion = multisine(arm.lower, arm.upper, arm.max_speed, int(rng.integers(2 ** 31)), options,
                       case.duration, rate)
    if case.one_way is not None:
        return _one_way(motion, arm, case, case.one_way, rng)
    places = case.duration * (np.array([0.2, 0.5, 0.8]) + rng.uniform(-0.04, 0.04, 3))
    rests = rng.uniform(1.0, 4.0, 3) * min(1.0, case.duration / 60.0)
    return with_pauses(motion, tuple(Pause(float(a), float(b)) for a, b in zip(places, rests)))


def _one_way(motion: Motion, arm: Arm, case: Case, joint: int,
             rng: np.random.Generator) -> Motion:
    """Return the motion with one joint sweeping upwards, at a speed that comes and goes."""
    cycles = int(rng.integers(3, 8))
    omega = 2 * np.pi * cycles / case.duration
    phase, depth = float(rng.uniform(0, 2 * np.pi)), 0.6
    lower, upper = float(arm.lower[joint]), float(arm.upper[joint])
    speed = min(rng.uniform(0.5, 0.8) * (upper - lower) / case.duration, 0.5 * case.max_speed)
    swing = 2 * depth * speed / omega
    start = rng.uniform(lower + swing, upper - speed * case.duration - swing)

    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        q, qd, qdd = (values.copy() for values in motion.path(t))
        angle = omega * np.asarray(t) + phase
        q[:, joint] = start + speed * (t - depth / omega * (np.cos(angle) - np.cos(phase)))
        qd[:, joint] = speed * (1 + depth * np.sin(angle))
        qdd[:, joint] = speed * depth * omega * np.cos(angle)
        return q, qd, qdd

    rate = 1.0 / float(motion.t[1] - motion.t[0])
    return sample('one way', path, case.duration, rate)
