"""Learning: submits jobs to the fit process, and takes models into use or rolls them back."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.arm import Arm, payload_limits
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.diagnostics import Learning
from gravity_comp_ros.node.job_messages import (
    AnyJob, DiagnosisJob, DiagnosisResult, FitJob, FitResult, PayloadJob, PayloadResult)
from gravity_comp_ros.node.model_history import ModelHistory, Reply
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.torque_source import UncertainChange
from gravity_comp_ros.node.watch import LEARN, Suspicion
from gravity_comp_ros.worker.supervised import Failure, READY, Supervised
from gravity_comp_ros.worker.worker_process import command

NICENESS = 10
# Number of samples from which an epoch is restarted after a refusal for broken effort, so that
# samples after a repair are not fitted together with broken ones. Below it more samples may
# resolve the refusal.
MIN_DROPPED = 100
FIT, DIAGNOSIS, PAYLOAD = 'fit', 'diagnosis', 'payload test'
# Checks of the last decisions that are kept until they are published.
MAX_CHECKS = 20


@dataclass(frozen=True)
class Request:
    """One call of `~/refit` or `~/diagnose`: its reply, and its deadline in s."""

    reply: Reply
    until: float
    is_diagnosis: bool


@dataclass(frozen=True)
class Submitted:
    """The running job: its number and kind. Another thread builds the job itself."""

    number: int
    kind: str


class Learner:
    """
    Starts fits of an arm's samples, takes models into use, and rolls back wrong ones.

    :param log_lines: events for the log: (is it a warning, sentence).
    """

    def __init__(self, settings: Parameters, models: ModelHistory,
                 log_lines: deque[tuple[bool, str]]) -> None:
        self.settings = settings
        self.models = models
        self.fits = Supervised(command('gravity_comp_ros.node.jobs:fitting', NICENESS),
                               settings.fit_timeout)
        # Suspected payloads, and checks of decisions as JSON, that are not published yet.
        self.events: deque[Suspicion] = deque(maxlen=10)
        self.decisions: deque[str] = deque(maxlen=MAX_CHECKS)
        # The checks of the last decision about a model.
        self.last_checks: tuple[Check, ...] = ()
        self._log_lines = log_lines
        self.jobs = 0
        # Results of jobs up to this number are discarded.
        self._outdated = 0
        # The call whose job has not started, and the one that waits for job `_number`.
        self._queued: Request | None = None
        self._waiting: tuple[int, Request] | None = None
        # The model in use when the epoch began, whose change by a payload is fitted.
        self.base: GravityModel | None = None
        self._last_fit = 'none'
        # Why the last fit failed; empty if it did not.
        self._fit_failure = ''
        # Outliers of the last fit, as text.
        self._outliers = ''
        self._kept_old = self._compensated = self._broken = False

    def poll(self, arm: Arm | None, now: float, wall: float) -> None:
        """Handle the results of the fit process, and submit the next job."""
        job = self.fits.job
        for event in self.fits.poll(wall):
            if isinstance(event, DiagnosisResult):
                self._reply(event.number, True, event.text)
            elif isinstance(event, Failure):
                self._failed(arm, event, job is not None and job.kind == FIT)
            elif arm is not None and isinstance(event, FitResult):
                self._fit_ended(arm, event, now)
            elif arm is not None:
                self._payload_job_ended(arm, event, now)
        if arm is None:
            return
        self._expire(wall)
        self._roll_back_if_worse(arm, now)
        if self.fits.state == READY:
            if self._queued is not None:
                self._start_request(arm, wall)
            elif (model := self._tested_model(arm)) is not None and arm.payload.is_due():
                window, limits = arm.payload.window(), payload_limits(self.settings)
                self._submit(PAYLOAD, wall, lambda number: PayloadJob(
                    number, window, model, limits, arm.geometry))
            elif self.settings.auto_fit and arm.epoch.fit_is_due():
                self._submit_fit(arm, wall)

    def _submit(self, kind: str, wall: float, prepare: Callable[[int], AnyJob]) -> None:
        """Submit a job; `prepare` builds it from its number, in another thread."""
        self.jobs += 1
        self.fits.submit(Submitted(self.jobs, kind), wall, lambda job: prepare(job.number))

    def _start_request(self, arm: Arm, wall: float) -> None:
        """Submit the job of the queued call."""
        request, self._queued = self._queued, None
        assert request is not None
        if (missing := arm.epoch.missing_for_fit()) is not None:
            # The payload has changed since the call.
            request.reply(False, missing)
            return
        if request.is_diagnosis:
            samples, model = arm.epoch.snapshot(), self.models.model
            self._submit(DIAGNOSIS, wall,
                         lambda number: DiagnosisJob(number, samples.all(), model))
        else:
            self._submit_fit(arm, wall, on_request=True)
        self._waiting = self.jobs, request

    def _submit_fit(self, arm: Arm, wall: float, on_request: bool = False) -> None:
        samples, epoch = arm.epoch.snapshot(), arm.epoch.number
        base, old, settings = self.base, self.models.model, self.settings
        limits, geometry = payload_limits(settings), arm.geometry
        self._submit(FIT, wall, lambda number: FitJob(
            number, epoch, samples.train(), samples.held_out(), base, old, settings.formulation,
            settings.effects, on_request, limits, geometry, samples.sent()))
        arm.epoch.fit_started()

    def _tested_model(self, arm: Arm) -> GravityModel | None:
        """Return the model in use if it is confirmed and of the present payload."""
        entry = self.models.entry
        if entry is None or not arm.is_confirmed or (
                arm.epoch.is_open and entry.epoch != arm.epoch.number):
            return None
        return entry.model

    def _payload_job_ended(self, arm: Arm, result: PayloadResult, now: float) -> None:
        """Report a new suspicion; open an epoch with `on_suspected_payload: learn`."""
        if result.number <= self._outdated:
            return
        self._decided('payload', result.text, (*result.checks, arm.payload.lasts()))
        suspicion = arm.payload.add_finding(result)
        if suspicion is None:
            return
        self.events.append(suspicion)
        self._log_lines.append((True, suspicion.text))
        if self.settings.on_suspected_payload == LEARN:
            success, text = self.payload_changed(arm, now)
            arm.epoch.note = f'opened automatically: {suspicion.text}'
            self._log_lines.append((not success, text))

    def _decided(self, decision: str, result: str, judged: tuple[Check, ...]) -> None:
        """Keep the checks of a decision for `~/checks`."""
        self.decisions.append(checks.to_json(decision, result, judged))

    def _fit_ended(self, arm: Arm, result: FitResult, now: float) -> None:
        if result.number <= self._outdated:
            if result.epoch == arm.epoch.number:
                arm.epoch.fit_ended(False)
            self._reply(result.number, False, 'payload_changed or rollback was called during the '
                        'fit; its result was discarded')
            return
        arm.epoch.fit_ended(not result.fault)
        self._compensated, self._broken = result.is_compensated, bool(result.fault)
        self._kept_old = not result.accepted
        self._fit_failure = ''
        # Friction at the start of a motion causes a single outlier.
        self._outliers = ', '.join(f'{n} of {name}' for name, n in result.outliers.items()
                                   if n > 1)
        left_out = f' (without outliers: {self._outliers})' if self._outliers else ''
        self._last_fit = (f'{result.how}, {result.model.coverage.n_samples} samples{left_out}, '
                          f'{result.seconds:.2f} s: {result.reason}')
        self.last_checks = result.checks
        if result.accepted:
            self._use(arm, result, now)
            return
        kept = 'no model yet' if self.models.model is None else 'the old model stays in use'
        self._report(result.number, False, f'{kept}: {self._last_fit}')
        if result.fault or result.is_compensated:
            self._refuse(arm, result.fault or result.reason, now)

    def _use(self, arm: Arm, result: FitResult, now: float) -> None:
        """Take a new model into use."""
        entry = self.models.use(result.model, f'{result.how} in epoch {result.epoch}', now,
                                arm.epoch.number)
        before, base = self.models.before, self.base
        # The samples of a closed epoch determine the whole change.
        change = UncertainChange(result.model, base, result.low, result.high) if (
            arm.epoch.is_open and base is not None
            and base.joints == result.model.joints) else None
        arm.use(entry.model, None if before is None else before.model,
                result.model.coverage.n_samples, change)
        arm.epoch.note = ''
        self.models.problem = ''
        self._report(result.number, True, f'new model in use: {self._last_fit}')
        if self.settings.auto_save and self.models.path:
            self.models.save(self._saved)

    def _saved(self, success: bool, text: str) -> None:
        if not success:
            self.models.problem = text
        self._log_lines.append((not success, text))

    def _refuse(self, arm: Arm, why: str, now: float) -> None:
        """Record broken effort; roll back an unconfirmed model of it, and drop its samples."""
        entry = self.models.entry
        if entry is not None and entry.epoch == arm.epoch.number and self.models.n_past and (
                not arm.is_confirmed):
            self._roll_back_automatically(arm, why, now)
            return
        arm.epoch.note = f'a model was refused: {why}'
        if arm.epoch.n_samples >= MIN_DROPPED and arm.epoch.is_open and (
                not self._compensated):
            arm.epoch.restart_after_broken_effort()
            arm.epoch.note += '; its samples were dropped'

    def _report(self, number: int, success: bool, text: str) -> None:
        """Reply to the call that waits for a job, log the text, and publish the checks."""
        self._reply(number, success, text)
        self._log_lines.append((not success, f'{text} [{checks.summary(self.last_checks)}]'))
        self._decided('model', text, self.last_checks)

    def _failed(self, arm: Arm | None, failure: Failure, is_fit: bool) -> None:
        """Report a job without a result; only a failed fit is a state of learning."""
        if failure.number is None:
            return
        kept = ('there is no model yet' if self.models.model is None
                else 'the old model stays in use')
        text = f'{failure.reason}; {kept}'
        self._reply(failure.number, False, text)
        self._log_lines.append((True, text))
        if is_fit and arm is not None:
            arm.epoch.fit_ended(False)
            self._last_fit, self._fit_failure = f'failed: {failure.reason}', failure.reason

    def _roll_back_if_worse(self, arm: Arm, now: float) -> None:
        judged = arm.model_checks()
        if judged and not any(check.passed for check in judged):
            self._decided('rollback', judged[0].text, tuple(judged))
            self._roll_back_automatically(arm, judged[0].text, now)

    def _roll_back_automatically(self, arm: Arm, why: str, now: float) -> None:
        """Roll back to the last model of the previous payload, and start to collect again."""
        entry = self.models.roll_back(now)
        if entry is None:
            return
        arm.use(entry.model, None, 0)
        self._outdated = self.jobs
        self.base = entry.model
        arm.epoch.restart_after_broken_effort()
        arm.epoch.note = f'rolled back automatically to the {entry.describe()}: {why}'
        self._broken = True
        self._last_fit = arm.epoch.note
        self._log_lines.append((True, arm.epoch.note))

    def payload_changed(self, arm: Arm, now: float) -> tuple[bool, str]:
        """Open a new epoch: drop the samples; keep the model in use until a better one exists."""
        if arm.epoch.is_open and arm.epoch.n_samples == 0:
            return True, f'{arm.epoch.describe()}; it was open already'
        dropped = arm.epoch.n_samples
        arm.new_epoch(now, can_change(self.models.model))
        self._outdated = self.jobs
        self.base = self.models.model
        self._kept_old = self._compensated = self._broken = False
        self._outliers = self._fit_failure = ''
        model = 'no model yet' if self.models.model is None else 'the old model stays in use'
        return True, (f'epoch {arm.epoch.number} open, {dropped} old samples dropped; {model} '
                      'until a better one is learned: move the arm slowly through its range')

    def roll_back(self, arm: Arm, now: float) -> tuple[bool, str]:
        """Bring back the last model of the previous payload; no automatic fit follows."""
        entry = self.models.roll_back(now)
        if entry is None:
            return False, 'there is no model of an earlier payload to roll back to'
        arm.use(entry.model, None, 0)
        arm.epoch.is_open = False
        self._outdated = self.jobs
        return True, (f'rolled back to the {entry.describe()}, of the previous payload; models of '
                      f'{self.models.n_past} earlier payloads remain; no fit until '
                      'payload_changed or refit is called')

    def request(self, arm: Arm, wall: float, reply: Reply, is_diagnosis: bool) -> None:
        """Queue a fit or a diagnosis; `reply` is called once, now or at its end."""
        is_busy = self._queued is not None or self._waiting is not None
        if is_busy or (self.fits.job is not None and self.fits.job.kind != PAYLOAD):
            reply(False, f'a fit is running already ({self.fits.seconds(wall):.1f} s); its '
                  'result will be in /diagnostics')
        elif (missing := arm.epoch.missing_for_fit()) is not None:
            reply(False, missing)
        else:
            self._queued = Request(reply, wall + self.settings.refit_timeout, is_diagnosis)

    def _reply(self, number: int, success: bool, text: str) -> None:
        """Reply to the call that waits for job `number`, if there is one."""
        if self._waiting is not None and self._waiting[0] == number:
            request, self._waiting = self._waiting[1], None
            request.reply(success, text)

    def _expire(self, wall: float) -> None:
        """Reply to calls past their deadline."""
        if self._queued is not None and wall > self._queued.until:
            request, self._queued = self._queued, None
            request.reply(False, f'the fit process is {self.fits.state}: '
                          f'{self.fits.last_loss or "no fit has started"}; try again')
        if self._waiting is not None and wall > self._waiting[1].until:
            request, self._waiting = self._waiting[1], None
            request.reply(False, 'the fit is still running; its result will be in /diagnostics')

    def status(self, arm: Arm) -> Learning:
        """Return the figures of learning for diagnostics."""
        epoch, fits = arm.epoch, self.fits
        loss = '' if fits.state in (READY, 'fitting') else fits.last_loss
        return Learning(
            epoch.describe(), epoch.n_samples, epoch.n_held_out, epoch.short_of_range(),
            arm.gate_counts, fits.state, fits.restarts, fits.pid, loss or self._fit_failure,
            self._last_fit, self._kept_old, self._compensated, self._broken, self._outliers,
            self.last_checks)

    def close(self) -> None:
        """End the fit process, and reply to pending calls."""
        pending = [self._queued, self._waiting[1] if self._waiting else None]
        self._queued = self._waiting = None
        for request in pending:
            if request is not None:
                request.reply(False, 'the node shuts down')
        self.fits.stop()
        self.models.close()


def can_change(model: GravityModel | None) -> bool:
    """Return whether a change of this model can be fitted."""
    return model is not None and model.energy is not None
