"""What the node does, free of ROS: messages and time go in, torques and sentences come out."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from typing import Any, cast

from gravity_comp_ros.data.gate import RATE
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import GravityCompError, ModelFileError, OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node import diagnostics
from gravity_comp_ros.node.arm import Arm
from gravity_comp_ros.node.arm_description import describe_arm
from gravity_comp_ros.node.fit_messages import Findings, Job, Look, Outcome, Question, Seen
from gravity_comp_ros.node.fit_process import Failure, FitProcess
from gravity_comp_ros.node.fit_requests import FitRequests, Reply, Request
from gravity_comp_ros.node.live_friction import usual_residual
from gravity_comp_ros.node.messages import Reading
from gravity_comp_ros.node.model_history import Entry, Models
from gravity_comp_ros.node.parameters import check_together, payload_limits, Value
from gravity_comp_ros.node.payload_watch import LEARN, Suspicion
from gravity_comp_ros.node.realtime_effects import compensable
from gravity_comp_ros.node.unsure_change import UnsureChange

Answer = tuple[bool, str]

# After a refusal of broken effort, so many samples are kept in the hope that more tell more; then
# they go, so that effort that has healed is not judged together with what came before.
KEPT_BROKEN = 100
NO_JOINTS = 'no joint states yet: is the topic right, and does the driver run?'


class Live:
    """
    Reads joint states, learns, and says which torque to publish.

    :param settings: all parameters of `parameters.TABLE`, checked.
    :param topic: the input topic, to be named in diagnostics.
    :raises OptionError: if the settings contradict each other.
    """

    def __init__(self, settings: Mapping[str, Value], topic: str, now: float) -> None:
        self.settings = dict(settings)
        self.problem = ''
        self.wants_save = False
        # How often messages came faster than they could be handled, since the start.
        self.late = self._late_reported = 0
        self._topic = topic
        self._settings_checked(())
        self.models = Models(str(settings['model_file']), cast(int, settings['history']))
        self.fits = FitProcess(cast(float, settings['fit_timeout']))
        self.arm: Arm | None = None
        self._jobs = 0
        # Results of jobs up to this number come too late to be used.
        self._outdated = 0
        self._description = ''
        # Joints that were taken from a first message, which may be a gripper's.
        self._guessed = False
        # What happened, for the log: (is it bad news, sentence).
        self.news: deque[tuple[bool, str]] = deque(maxlen=100)
        # Payloads that the node was not told of and has not reported yet.
        self.events: deque[Suspicion] = deque(maxlen=10)
        self._requests = FitRequests()
        # The model in use when the epoch began: what a new payload changes.
        self._base: GravityModel | None = None
        self._last_fit = 'none'
        # Samples that the last fit left out because something acted for a moment, in words.
        self._outliers = ''
        self._kept_old = self._compensated = self._broken = False
        self._unnamed: Counter[str] = Counter()
        joints = cast(tuple[str, ...], settings['joints'])
        try:
            entry = self.models.load(joints, now)
        except GravityCompError as problem:
            # A damaged file must not stop the node: it starts without a model and says so.
            entry, self.problem = None, str(problem)
        if joints or entry:
            self._begin(joints or entry.model.joints, entry)  # type: ignore[union-attr]

    def _settings_checked(self, joints: tuple[str, ...]) -> None:
        check_together(self.settings, joints)

    def set(self, settings: Mapping[str, Value]) -> None:
        """Use changed settings from now on; they have been checked."""
        self.settings = dict(settings)
        self.fits.timeout = cast(float, settings['fit_timeout'])
        if self.arm is not None:
            self.arm.set(self.settings)

    def _begin(self, joints: tuple[str, ...], entry: Entry | None) -> None:
        self._settings_checked(joints)
        check_effects(self.settings, joints)
        self.arm = Arm(joints, self.settings, is_open=entry is None,
                       has_base=entry is not None and _can_change(entry.model))
        if entry is not None:
            self.arm.use(entry.model, None, 0)
            self._base = entry.model
        self.news.append((False, f'arm of {len(joints)} joints: {", ".join(joints)}; model: '
                          f'{entry.describe() if entry else "none yet"}; formulation of fits: '
                          f'{self.settings["formulation"]}; bound of the torque: '
                          f'{self.settings["max_torque"] or "none set"}'))
        self._use_description()

    def describe(self, text: str) -> None:
        """Use a robot description from now on."""
        self._description = text
        self._use_description()

    def _use_description(self) -> None:
        arm = self.arm
        if arm is None or not self._description:
            return
        found = describe_arm(self._description, arm.joints)
        arm.describe(found)
        axes = f'not used: {found.problem}' if found.geometry is None else 'used'
        limits = ', '.join(f'{limit:g}' for limit in found.max_effort) or 'none'
        self.news.append((bool(found.problem), f'robot description: axes {axes}; effort limits '
                          f'{limits} N·m; joints without end: '
                          f'{", ".join(found.continuous) or "none"}'))

    def message(self, message: Any, now: float, arrival: float
                ) -> tuple[Reading | None, FloatArray | None]:
        """
        Take in a `sensor_msgs/JointState`; return what it says and the torque to publish.

        :param now: monotonic time in s, for ramps and the watchdog.
        :param arrival: time in s for a message without a stamp.
        """
        arm = self.arm
        if arm is None or (self._guessed and self._is_larger(arm, message.name)):
            arm = self._meet(tuple(message.name))
            if arm is None:
                return None, None
        reading = arm.reader.read(message, arrival)
        if reading is None:
            return None, None
        # What the arm measures now, it measures of what was published before.
        learns = (reading.qd is not None and reading.tau is not None and arm.is_settled(now))
        if reading.new_run:
            arm.gate.reset()
            arm.health.restart()
            arm.payload.restart()
        if learns:
            self._learn(arm, reading, now)
        tau = arm.torque(now, reading)
        arm.last_seen, arm.pose = now, reading.q
        return reading, tau

    def _is_larger(self, arm: Arm, names: Sequence[str]) -> bool:
        """Return whether another device with more joints speaks before there is a model."""
        return (self.models.model is None and self._jobs == 0 and arm.reader.joints != names
                and len(set(names)) == len(names) and len(arm.joints) < len(names) <= 10)

    def _meet(self, names: tuple[str, ...]) -> Arm | None:
        """Take the joints from a first message."""
        try:
            if not names or len(set(names)) != len(names):
                raise OptionError(f'the first message on {self._topic} has '
                                  f'{"repeated" if names else "no"} joint names; set the '
                                  'parameter joints')
            if len(names) > 10:
                raise OptionError(f'{self._topic} has {len(names)} joints and a model takes at '
                                  'most 10; set the parameter joints')
            self._begin(names, None)
            self._guessed = True
        except OptionError as problem:
            self.problem = str(problem)
            self._unnamed['missing_joint'] += 1
            return None
        self.problem = ''
        return self.arm

    def _learn(self, arm: Arm, reading: Reading, now: float) -> None:
        q, qd, tau = reading.q, cast(FloatArray, reading.qd), cast(FloatArray, reading.tau)
        reason = arm.gate.offer(reading.t, q, qd)
        if reason is not None:
            if reason != RATE:
                arm.gate_counts[reason] += 1
            return
        predicted = arm.predicted(reading)
        model = self.models.model
        fault = arm.health.fault(q, tau, predicted,
                                 None if model is None else usual_residual(model))
        if fault is not None:
            arm.gate_counts[fault] += 1
            return
        arm.epoch.offer(reading.t, q, qd, tau, arm.sent.around(now))
        if predicted is not None:
            arm.compared(reading, predicted)
            if (objection := arm.objection()) is not None:
                self._roll_back_alone(arm, objection, now)

    def _roll_back_alone(self, arm: Arm, why: str, now: float) -> None:
        """Go back to the last good model by itself, and start to collect again."""
        entry = self.models.roll_back(now)
        if entry is None:
            return
        arm.use(entry.model, None, 0)
        self._outdated = self._jobs
        self._base = entry.model
        arm.epoch.restart()
        arm.epoch.note = f'rolled back by itself to the {entry.describe()}: {why}'
        self._broken = True
        self._last_fit = arm.epoch.note
        self.news.append((True, arm.epoch.note))

    def tick(self, now: float, wall: float | None = None) -> FloatArray | None:
        """
        Look after fits and the watchdog; return the torque to publish without input.

        :param wall: the time for fits and calls where `now` is that of a simulation, whose
            pauses and leaps are no reason to give up a fit, or to wait for one for ever.
        """
        wall = now if wall is None else wall
        for event in self.fits.poll(wall):
            if isinstance(event, Outcome):
                self._finish(event, now)
            elif isinstance(event, Findings):
                self._requests.reply(event.number, True, event.text)
            elif isinstance(event, Seen):
                self._look_ended(event, now)
            else:
                self._fail(event)
        arm = self.arm
        if arm is None:
            return None
        self._requests.expire(wall, f'{self.fits.state}: '
                              f'{self.fits.last_failure or "no fit has begun"}')
        if self.fits.state == 'ready':
            if self._requests.wanted is not None:
                self._serve(arm, wall)
            elif self._may_suspect(arm) and arm.payload.is_due():
                self._submit_look(arm, wall)
            elif self.settings['auto_fit'] and arm.epoch.fit_is_due():
                self._submit(arm, wall)
        arm.look_at_change(now)
        return arm.watch(now)

    def _serve(self, arm: Arm, wall: float) -> None:
        """Start what somebody waits for."""
        request = self._requests.take()
        if (lack := arm.lack()) is not None:
            # The payload has changed since it was asked for.
            request.reply(False, lack)
            return
        number = self._submit_question(arm, wall) if request.is_question \
            else self._submit(arm, wall, asked=True)
        self._requests.wait(number, request)

    def _submit(self, arm: Arm, now: float, asked: bool = False) -> int:
        self._jobs += 1
        job = Job(self._jobs, arm.epoch.number, arm.epoch.train(), arm.epoch.held(),
                  self._base, self.models.model, str(self.settings['formulation']),
                  cast(tuple[str, ...], self.settings['effects']), asked,
                  payload_limits(self.settings), arm.geometry, arm.epoch.sent())
        self.fits.submit(job, now)
        arm.epoch.fit_started()
        return self._jobs

    def _submit_question(self, arm: Arm, now: float) -> int:
        self._jobs += 1
        self.fits.submit(Question(self._jobs, arm.epoch.every(), self.models.model), now)
        return self._jobs

    def _may_suspect(self, arm: Arm) -> bool:
        """Return whether the model in use is one of this payload, and predicts it."""
        entry = self.models.entry
        return entry is not None and arm.is_confirmed and (
            not arm.epoch.is_open or entry.epoch == arm.epoch.number)

    def _submit_look(self, arm: Arm, now: float) -> None:
        self._jobs += 1
        self.fits.submit(Look(self._jobs, arm.payload.window(), cast(
            GravityModel, self.models.model), payload_limits(self.settings), arm.geometry), now)

    def _look_ended(self, seen: Seen, now: float) -> None:
        """Report a payload that is new, and learn it where that is wanted."""
        arm = cast(Arm, self.arm)
        if seen.number <= self._outdated:
            return
        suspicion = arm.payload.found(seen.finding, seen.since)
        if suspicion is None:
            return
        self.events.append(suspicion)
        self.news.append((True, suspicion.text))
        if self.settings['on_suspected_payload'] == LEARN:
            success, text = self.payload_changed(now)
            arm.epoch.note = f'opened by itself: {suspicion.text}'
            self.news.append((not success, text))

    def _finish(self, outcome: Outcome, now: float) -> None:
        arm = cast(Arm, self.arm)
        if outcome.number <= self._outdated:
            if outcome.epoch == arm.epoch.number:
                arm.epoch.fit_ended(False)
            self._requests.reply(outcome.number, False, 'payload_changed or rollback was called '
                                 'while it was fitted; the result was thrown away')
            return
        verdict = outcome.verdict
        arm.epoch.fit_ended(not verdict.broken)
        self._compensated, self._broken = verdict.compensated, bool(verdict.broken)
        self._kept_old = not verdict.better
        self.fits.last_failure = ''
        # A single one is what friction does as a joint sets out.
        self._outliers = ', '.join(f'{n} of {name}' for name, n in outcome.outliers.items()
                                   if n > 1)
        left_out = f' (without outliers: {self._outliers})' if self._outliers else ''
        self._last_fit = (f'{outcome.how}, {len_text(outcome)}{left_out}, '
                          f'{outcome.seconds:.2f} s: {verdict.reason}')
        if verdict.better:
            self._take(arm, outcome, now)
            return
        kept = 'no model yet' if self.models.model is None else 'the old model stays'
        self._tell(outcome.number, False, f'{kept}: {self._last_fit}')
        if verdict.broken or verdict.compensated:
            self._refused(arm, verdict.broken or verdict.reason, now)

    def _take(self, arm: Arm, outcome: Outcome, now: float) -> None:
        """Go over to a new model."""
        entry = self.models.use(outcome.model, f'{outcome.how} in epoch {outcome.epoch}', now,
                                arm.epoch.number)
        before, base = self.models.before, self._base
        # A full epoch shows the whole payload.
        change = UnsureChange(outcome.model, base, outcome.low, outcome.high) if (
            arm.epoch.is_open and base is not None
            and base.joints == outcome.model.joints) else None
        arm.use(entry.model, None if before is None else before.model,
                outcome.model.coverage.n_samples, change)
        arm.epoch.note = ''
        self.problem = ''
        self.wants_save = bool(self.settings['auto_save'] and self.models.path)
        self._tell(outcome.number, True, f'new model in use: {self._last_fit}')

    def _refused(self, arm: Arm, why: str, now: float) -> None:
        """Say that effort is broken; go back if a model was learned from it, and collect anew."""
        entry = self.models.entry
        if entry is not None and entry.epoch == arm.epoch.number and self.models.n_past and (
                not arm.is_confirmed):
            self._roll_back_alone(arm, why, now)
            return
        arm.epoch.note = f'a model was refused: {why}'
        if arm.epoch.n_samples >= KEPT_BROKEN and arm.epoch.is_open and (
                not self._compensated):
            arm.epoch.restart()
            arm.epoch.note += '; its samples were dropped'

    def _tell(self, number: int, success: bool, text: str) -> None:
        """Answer whoever waits for a job, and the log."""
        self._requests.reply(number, success, text)
        self.news.append((not success, text))

    def _fail(self, failure: Failure) -> None:
        if self.arm is not None and failure.number is not None:
            self.arm.epoch.fit_ended(False)
            self._last_fit = f'failed: {failure.reason}'
            kept = 'there is no model yet' if self.models.model is None else 'the old model stays'
            self._tell(failure.number, False, f'{failure.reason}; {kept}')

    def payload_changed(self, now: float) -> Answer:
        """Open a new epoch: old samples go, the model in use stays until a better one is there."""
        arm = self.arm
        if arm is None:
            return False, NO_JOINTS
        if arm.epoch.is_open and arm.epoch.n_samples == 0:
            return True, f'{arm.epoch.describe()}; it was open already'
        old = arm.epoch.n_samples
        arm.new_epoch(self.settings, now, _can_change(self.models.model))
        self._outdated = self._jobs
        self._base = self.models.model
        self._kept_old = self._compensated = self._broken = False
        self._outliers = ''
        model = 'no model yet' if self.models.model is None else 'the old model stays in use'
        return True, (f'epoch {arm.epoch.number} open, {old} old samples dropped; {model} until '
                      'a better one is learned: move the arm slowly through its range')

    def refit(self, wall: float, reply: Reply) -> None:
        """Fit what was collected; `reply` is called once, now or when the fit has ended."""
        self._want(wall, reply, is_question=False)

    def diagnose(self, wall: float, reply: Reply) -> None:
        """Ask which effect the model lacks; `reply` as for `refit`."""
        self._want(wall, reply, is_question=True)

    def _want(self, wall: float, reply: Reply, is_question: bool) -> None:
        arm = self.arm
        if arm is None:
            reply(False, NO_JOINTS)
        elif self._requests.is_busy or isinstance(self.fits.job, (Job, Question)):
            reply(False, f'a fit is running already ({self.fits.seconds(wall):.1f} s); its '
                  'outcome will be in /diagnostics')
        elif (lack := arm.lack()) is not None:
            reply(False, lack)
        else:
            until = wall + cast(float, self.settings['refit_timeout'])
            self._requests.want(Request(reply, until, is_question))

    def rollback(self, now: float) -> Answer:
        """Bring back the last model of the payload before; no fit follows by itself."""
        entry = self.models.roll_back(now)
        if entry is None or self.arm is None:
            return False, 'there is no earlier model to go back to: none of an earlier payload'
        self.arm.use(entry.model, None, 0)
        self.arm.epoch.is_open = False
        self._outdated = self._jobs
        return True, (f'back to the {entry.describe()}, of the payload before; '
                      f'{self.models.n_past} earlier payloads left; no fit until '
                      'payload_changed or refit')

    def enable(self, enabled: bool) -> Answer:
        """Ramp torque up or down."""
        if self.arm is None:
            return False, NO_JOINTS
        self.arm.enable(enabled)
        if enabled and not self.arm.is_limited:
            return False, ('no torque is published without a bound: set max_torque, or '
                           'unlimited_torque')
        seconds = self.settings['ramp_time']
        if enabled:
            return True, f'torque ramps up over {seconds} s'
        return True, f'torque ramps down to zero over {seconds} s, then nothing is published'

    def save(self) -> Answer:
        """Write the model file; called from another thread, for a disk may be slow."""
        try:
            return True, self.models.save()
        except ModelFileError as problem:
            return False, str(problem)

    def save_alone(self) -> None:
        """Write the model file because a new model is in use; say if that fails."""
        success, text = self.save()
        if not success:
            self.problem = text
        self.news.append((not success, text))

    def is_interleaved(self) -> bool:
        """Return whether the last report counted messages out of order."""
        return self.arm is not None and self.arm.is_interleaved

    def close(self) -> None:
        """End the fit process, and answer whoever waits."""
        self._requests.close()
        self.fits.stop()

    def statuses(self, now: float) -> list[diagnostics.Status]:
        """Return what to publish on /diagnostics; counts since the last call start again."""
        entry = self.models.entry
        model = diagnostics.model_status(
            entry.describe() if entry else None, max(0.0, now - entry.since) if entry else 0.0,
            self.models.n_past, self.problem)
        arm = self.arm
        if arm is None:
            received = sum(self._unnamed.values())
            return [diagnostics.input_status(self._topic, received, received, None, False,
                                             self._unnamed, self._unnamed), model]
        late, self._late_reported = self.late - self._late_reported, self.late
        return [arm.input_status(self._topic, now, late), model,
                diagnostics.learning_status(self._learning(arm)),
                diagnostics.payload_status(
                    arm.payload.suspicion.text if arm.payload.suspicion else '',
                    arm.payload.other),
                *arm.statuses(self.models.model, now)]

    def _learning(self, arm: Arm) -> diagnostics.Learning:
        epoch, fits = arm.epoch, self.fits
        return diagnostics.Learning(
            epoch.describe(), epoch.n_samples, epoch.n_held, epoch.lacking(), arm.gate_counts,
            fits.state, fits.restarts, fits.pid, fits.last_failure, self._last_fit,
            self._kept_old, self._compensated, self._broken, arm.fresh_faults(),
            self._outliers)


def check_effects(settings: Mapping[str, Value], joints: tuple[str, ...]) -> None:
    """
    Check that effects are named that there are, on joints of the arm.

    :raises OptionError: if not, or if one to be compensated is not fit for that.
    """
    try:
        requests(cast(tuple[str, ...], settings['effects']), joints)
    except OptionError as problem:
        raise OptionError(f'parameter effects: {problem}') from problem
    compensable(cast(tuple[str, ...], settings['compensate']), joints)


def _can_change(model: GravityModel | None) -> bool:
    return model is not None and model.energy is not None


def len_text(outcome: Outcome) -> str:
    """Return how many samples a model was learned from."""
    return f'{outcome.model.coverage.n_samples} samples'
