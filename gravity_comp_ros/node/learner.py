"""Learning: submits jobs to the fit process, and takes models into use or rolls them back."""

from __future__ import annotations

from collections import deque

from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.arm import Arm
from gravity_comp_ros.node.diagnostics import Learning
from gravity_comp_ros.node.fit_messages import (
    DiagnosisJob, DiagnosisResult, FitJob, FitResult, PayloadJob, PayloadResult)
from gravity_comp_ros.node.fit_process import Failure, FitProcess
from gravity_comp_ros.node.fit_requests import FitRequests, Reply, Request
from gravity_comp_ros.node.model_history import ModelHistory
from gravity_comp_ros.node.options import payload_limits
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.payload_watch import LEARN, Suspicion
from gravity_comp_ros.node.uncertain_change import UncertainChange

# Number of samples from which an epoch is restarted after a refusal for broken effort, so that
# samples after a repair are not fitted together with broken ones. Below it more samples may
# resolve the refusal.
MIN_DROPPED = 100


class Learner:
    """
    Starts fits of an arm's samples, takes models into use, and rolls back wrong ones.

    :param log_lines: events for the log: (is it a warning, sentence).
    """

    def __init__(self, settings: Parameters, models: ModelHistory,
                 log_lines: deque[tuple[bool, str]]) -> None:
        self.settings = settings
        self.models = models
        self.fits = FitProcess(settings.fit_timeout)
        self.wants_save = False
        # Suspected payloads that are not published yet.
        self.events: deque[Suspicion] = deque(maxlen=10)
        self._log_lines = log_lines
        self.jobs = 0
        # Results of jobs up to this number are discarded.
        self._outdated = 0
        self._requests = FitRequests()
        # The model in use when the epoch began, whose change by a payload is fitted.
        self.base: GravityModel | None = None
        self._last_fit = 'none'
        # Outliers of the last fit, as text.
        self._outliers = ''
        self._kept_old = self._compensated = self._broken = False

    def poll(self, arm: Arm | None, now: float, wall: float) -> None:
        """Handle the results of the fit process, and submit the next job."""
        for event in self.fits.poll(wall):
            if isinstance(event, DiagnosisResult):
                self._requests.reply(event.number, True, event.text)
            elif arm is not None:
                self._ended(arm, event, now)
        if arm is None:
            return
        self._requests.expire(wall, f'{self.fits.state}: '
                              f'{self.fits.last_failure or "no fit has started"}')
        if self.fits.state == 'ready':
            if self._requests.queued is not None:
                self._start_request(arm, wall)
            elif (model := self._tested_model(arm)) is not None and arm.payload.is_due():
                self.jobs += 1
                self.fits.submit(PayloadJob(self.jobs, arm.payload.window(), model,
                                            payload_limits(self.settings), arm.geometry), wall)
            elif self.settings.auto_fit and arm.epoch.fit_is_due():
                self._submit(arm, wall)

    def _ended(self, arm: Arm, event: FitResult | PayloadResult | Failure, now: float) -> None:
        if isinstance(event, FitResult):
            self._fit_ended(arm, event, now)
        elif isinstance(event, PayloadResult):
            self._payload_job_ended(arm, event, now)
        else:
            self._job_failed(arm, event)

    def _start_request(self, arm: Arm, wall: float) -> None:
        """Submit the job of the queued call."""
        request = self._requests.take()
        if (missing := arm.missing_for_fit()) is not None:
            # The payload has changed since the call.
            request.reply(False, missing)
            return
        number = self._submit_diagnosis(arm, wall) if request.is_diagnosis \
            else self._submit(arm, wall, on_request=True)
        self._requests.wait(number, request)

    def _submit(self, arm: Arm, now: float, on_request: bool = False) -> int:
        self.jobs += 1
        job = FitJob(self.jobs, arm.epoch.number, arm.epoch.train(), arm.epoch.held_out(),
                     self.base, self.models.model, self.settings.formulation,
                     self.settings.effects, on_request,
                     payload_limits(self.settings), arm.geometry, arm.epoch.sent())
        self.fits.submit(job, now)
        arm.epoch.fit_started()
        return self.jobs

    def _submit_diagnosis(self, arm: Arm, now: float) -> int:
        self.jobs += 1
        self.fits.submit(DiagnosisJob(self.jobs, arm.epoch.all_samples(), self.models.model), now)
        return self.jobs

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
        suspicion = arm.payload.add_finding(result.finding, result.since)
        if suspicion is None:
            return
        self.events.append(suspicion)
        self._log_lines.append((True, suspicion.text))
        if self.settings.on_suspected_payload == LEARN:
            success, text = self.payload_changed(arm, now)
            arm.epoch.note = f'opened automatically: {suspicion.text}'
            self._log_lines.append((not success, text))

    def _fit_ended(self, arm: Arm, result: FitResult, now: float) -> None:
        if result.number <= self._outdated:
            if result.epoch == arm.epoch.number:
                arm.epoch.fit_ended(False)
            self._requests.reply(result.number, False, 'payload_changed or rollback was called '
                                 'during the fit; its result was discarded')
            return
        verdict = result.verdict
        arm.epoch.fit_ended(not verdict.broken)
        self._compensated, self._broken = verdict.compensated, bool(verdict.broken)
        self._kept_old = not verdict.better
        self.fits.last_failure = ''
        # Friction at the start of a motion causes a single outlier.
        self._outliers = ', '.join(f'{n} of {name}' for name, n in result.outliers.items()
                                   if n > 1)
        left_out = f' (without outliers: {self._outliers})' if self._outliers else ''
        self._last_fit = (f'{result.how}, {result.model.coverage.n_samples} samples{left_out}, '
                          f'{result.seconds:.2f} s: {verdict.reason}')
        if verdict.better:
            self._use(arm, result, now)
            return
        kept = 'no model yet' if self.models.model is None else 'the old model stays in use'
        self._report(result.number, False, f'{kept}: {self._last_fit}')
        if verdict.broken or verdict.compensated:
            self._refuse(arm, verdict.broken or verdict.reason, now)

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
        self.wants_save = self.settings.auto_save and bool(self.models.path)
        self._report(result.number, True, f'new model in use: {self._last_fit}')

    def _refuse(self, arm: Arm, why: str, now: float) -> None:
        """Record broken effort; roll back an unconfirmed model of it, and drop its samples."""
        entry = self.models.entry
        if entry is not None and entry.epoch == arm.epoch.number and self.models.n_past and (
                not arm.is_confirmed):
            self.roll_back_automatically(arm, why, now)
            return
        arm.epoch.note = f'a model was refused: {why}'
        if arm.epoch.n_samples >= MIN_DROPPED and arm.epoch.is_open and (
                not self._compensated):
            arm.epoch.restart_after_broken_effort()
            arm.epoch.note += '; its samples were dropped'

    def _report(self, number: int, success: bool, text: str) -> None:
        """Reply to the call that waits for a job, and log the text."""
        self._requests.reply(number, success, text)
        self._log_lines.append((not success, text))

    def _job_failed(self, arm: Arm, failure: Failure) -> None:
        if failure.number is not None:
            arm.epoch.fit_ended(False)
            self._last_fit = f'failed: {failure.reason}'
            kept = ('there is no model yet' if self.models.model is None
                    else 'the old model stays in use')
            self._report(failure.number, False, f'{failure.reason}; {kept}')

    def roll_back_automatically(self, arm: Arm, why: str, now: float) -> None:
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
        self._outliers = ''
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
        if self._requests.is_busy or isinstance(self.fits.job, (FitJob, DiagnosisJob)):
            reply(False, f'a fit is running already ({self.fits.seconds(wall):.1f} s); its '
                  'result will be in /diagnostics')
        elif (missing := arm.missing_for_fit()) is not None:
            reply(False, missing)
        else:
            until = wall + self.settings.refit_timeout
            self._requests.queue(Request(reply, until, is_diagnosis))

    def status(self, arm: Arm) -> Learning:
        """Return the figures of learning for diagnostics."""
        epoch, fits = arm.epoch, self.fits
        return Learning(
            epoch.describe(), epoch.n_samples, epoch.n_held_out, epoch.short_of_range(),
            arm.gate_counts, fits.state, fits.restarts, fits.pid, fits.last_failure,
            self._last_fit, self._kept_old, self._compensated, self._broken,
            arm.new_faults(), self._outliers)

    def close(self) -> None:
        """End the fit process, and reply to pending calls."""
        self._requests.close()
        self.fits.stop()


def can_change(model: GravityModel | None) -> bool:
    """Return whether a change of this model can be fitted."""
    return model is not None and model.energy is not None
