"""Hidden-effect cases: simulated recordings, and the expected diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from zlib import crc32

from bench.cases.arms import generated_arm, six_axis
from bench.cases.signals import Degradation, measured, Pause, with_pauses
from bench.shared.findings import Known, Pair
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.simulation.arms import Arm, iiwa7
from gravity_comp_ros.simulation.hidden import noise_levels
from gravity_comp_ros.simulation.motions import Motion, multisine, MultisineOptions, sample
from gravity_comp_ros.simulation.synthesise import Disturbance, synthesise, SynthesisOptions
import numpy as np

ARMS: dict[str, Callable[[], Arm]] = {
    'iiwa7': iiwa7, 'six_axis': six_axis,
    'right_seven': partial(generated_arm, 21, 7, True),
    'right_six': partial(generated_arm, 24, 6, True), 'any_six': partial(generated_arm, 28, 6)}

# Delays and LuGre friction require finer steps than those of a recording, Hz.
_SIMULATION_RATE = 200.0


@dataclass(frozen=True)
class Truth:
    """
    A true effect on a joint; its `equivalents` explain the same torque.

    `known` is None where the coefficients of simulation and library differ in meaning.
    """

    effect: str
    joint: int | None
    equivalents: tuple[Pair, ...] = ()
    known: Known | None = None

    @property
    def answers(self) -> frozenset[Pair]:
        return frozenset(((self.effect, self.joint), *self.equivalents))


@dataclass(frozen=True)
class Case:
    """
    A hidden-effect case on an arm of `ARMS`.

    `disturbances` act in every run, those of `in_run` in the run of their number only. A correct
    diagnosis finds all of `truths`, or calls them `untestable`. `allowed` are further effects that
    are present or follow from the truths.

    `max_speed` in rad/s is that of the fastest run. `one_way` is a joint that moves in one
    direction only, and never rests. With a `pause` in s between runs, their stamps are on one
    clock. `degraded` are losses between arm and recording.
    """

    name: str
    arm: str
    untestable: bool = False
    disturbances: tuple[Disturbance, ...] = ()
    truths: tuple[Truth, ...] = ()
    allowed: frozenset[Pair] = frozenset()
    in_run: tuple[tuple[int, Disturbance], ...] = ()
    runs: int = 5
    duration: float = 150.0
    max_speed: float = 0.35
    one_way: int | None = None
    pause: float | None = None
    degraded: tuple[Degradation, ...] = ()

    @property
    def expected(self) -> frozenset[Pair]:
        """Return all pairs that are correct answers to a truth."""
        return frozenset(pair for truth in self.truths for pair in truth.answers)


def recordings(case: Case, seed: int = 0, rate: float = 50.0) -> JointSamples:
    """
    Return the simulated recordings of a case at `rate` Hz.

    The motion of every run is another multisine with pauses. The same case and seed give the same
    samples.
    """
    arm = ARMS[case.arm]()
    streams = np.random.SeedSequence([crc32(f'{case.arm} {case.name}'.encode()), seed])
    noise = noise_levels(arm)
    every = max(1, int(np.ceil(_SIMULATION_RATE / rate)))
    runs = []
    for number, stream in enumerate(streams.spawn(case.runs)):
        motion_seed, disturbance_seed, noise_seed = stream.spawn(3)
        motion = run_motion(case, arm, number, rate * every, np.random.default_rng(motion_seed))
        acting = case.disturbances + tuple(d for run, d in case.in_run if run == number)
        options = SynthesisOptions(seed=int(disturbance_seed.generate_state(1)[0]),
                                   disturbances=acting)
        run = synthesise(arm, motion, options, f'{case.name} {number + 1}')
        run = run.select(np.arange(0, len(run), every))
        run = measured(run, noise, np.random.default_rng(noise_seed))
        runs.append(_recorded(case, number, run,
                              np.random.default_rng([number, *noise_seed.generate_state(2)])))
    return concatenate(runs)


def _recorded(case: Case, number: int, run: JointSamples,
              rng: np.random.Generator) -> JointSamples:
    """Return a run after the losses, with its start on a clock if there are pauses."""
    for degradation in case.degraded:
        run = degradation(run, rng)
    if case.pause is None:
        return run
    return replace(run, starts=(number * (case.duration + case.pause),))


def run_motion(case: Case, arm: Arm, number: int, rate: float,
               rng: np.random.Generator) -> Motion:
    """Return the motion of a run; the first has the highest speed."""
    speed = case.max_speed * (1.0 if number == 0 else rng.uniform(0.4, 1.0))
    options = MultisineOptions(max_speed=speed)
    motion = multisine(arm.lower, arm.upper, arm.max_speed, int(rng.integers(2 ** 31)), options,
                       case.duration, rate)
    if case.one_way is not None:
        return _one_way(motion, arm, case, case.one_way, rng)
    starts = case.duration * (np.array([0.2, 0.5, 0.8]) + rng.uniform(-0.04, 0.04, 3))
    rests = rng.uniform(1.0, 4.0, 3) * min(1.0, case.duration / 60.0)
    return with_pauses(motion, tuple(Pause(float(a), float(b)) for a, b in zip(starts, rests)))


def _one_way(motion: Motion, arm: Arm, case: Case, joint: int,
             rng: np.random.Generator) -> Motion:
    """Return the motion with one joint moving upwards only, at varying speed."""
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
