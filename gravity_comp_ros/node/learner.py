"""Learning: submits jobs to the fit process, and takes models into use or rolls them back."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
import math
from typing import Any

from gravity_comp_ros.node.arm import Arm
from gravity_comp_ros.node.checks import (
    Check, FIT, FitResult, Job, PAYLOAD, PayloadResult, Result, to_json)
from gravity_comp_ros.node.epoch import Epoch, FULL_FIT_SAMPLES, Rows, rows_of
from gravity_comp_ros.node.model_history import Entry, ModelHistory, Reply
from gravity_comp_ros.node.watch import LEARN
from gravity_comp_ros.worker.worker_process import Failed, READY, Supervised
import numpy as np

# States of learning: nothing to report, a model that was not used, a fault.
FINE, REFUSED, FAULTY = range(3)


@dataclass
class Pending:
    """
    A job that waits or runs: its kind, and the call of a service that waits for it until then, s.

    `origin` are epoch and model at its start. Its result is discarded if these have changed.
    """

    kind: str
    call: Reply | None = None
    until: float = math.inf
    origin: tuple[Epoch, Entry | None] | None = None

    def reply(self, success: bool, text: str) -> None:
        """Reply to the call that waits, if there is one."""
        call, self.call = self.call, None
        if call is not None:
            call(success, text)


@dataclass(frozen=True)
class Events:
    """
    What happened and is not published yet.

    `log` has pairs (is it a warning, sentence), `checks` decisions as JSON, `payloads` suspicions.
    """

    log: deque[tuple[bool, str]] = field(default_factory=deque)
    checks: deque[str] = field(default_factory=deque)
    payloads: deque[PayloadResult] = field(default_factory=deque)


class Learner:
    """Starts fits of an arm's samples, takes models into use, and rolls back wrong ones."""

    def __init__(self, arm: Arm, models: ModelHistory, fits: Supervised, events: Events) -> None:
        self.arm, self.models, self.fits, self._events = arm, models, fits, events
        # The checks of the last decision about a model.
        self.last_checks: tuple[Check, ...] = ()
        # The last fit as text, and what diagnostics report about it.
        self.last_fit = 'none'
        self.state, self.report = FINE, ''
        self.has_started = False
        # The job of a call that has not started.
        self._queued: Pending | None = None

    def poll(self, answers: Sequence[tuple[Pending | None, Any]], now: float, wall: float) -> None:
        """Handle jobs of the fit process that have ended, and submit the next job."""
        for job, answer in answers:
            if job is not None:
                self._ended(job, answer, now)
        self._expire(wall)
        judged = self.arm.watch.model_checks()
        if judged and not any(check.passed for check in judged):
            self._events.checks.append(to_json('rollback', judged[0].text, judged))
            self.roll_back(now, judged[0].text)
        if self.fits.state != READY:
            return
        if self._queued is not None:
            job, self._queued = self._queued, None
            if (missing := self.arm.epoch.missing_for_fit()) is None:
                self._submit(wall, job)
            else:
                # The payload has changed since the call.
                job.reply(False, missing)
        elif self._is_tested() and self.arm.watch.is_due():
            self._submit(wall, Pending(PAYLOAD))
        elif self.arm.settings.auto_fit and self.arm.epoch.fit_is_due():
            self._submit(wall, Pending(FIT))

    def _submit(self, wall: float, pending: Pending) -> None:
        """Submit a job; another thread prepares its samples."""
        arm, kind = self.arm, pending.kind
        job = partial(Job, kind, model=self.models.model, base=arm.epoch.base,
                      settings=arm.settings, geometry=arm.described.geometry,
                      on_request=pending.call is not None)
        if kind == PAYLOAD:
            window = arm.watch.window()
            rows = partial(Rows, window, np.zeros(len(window), dtype=bool))
        else:
            rows = partial(rows_of, arm.epoch.snapshot())
        if kind == FIT:
            arm.epoch.fit_started()
        self.has_started = True
        pending.origin = arm.epoch, self.models.entry
        self.fits.submit(pending, wall, lambda: job(rows()))

    def _is_tested(self) -> bool:
        """Return whether the model in use is confirmed and of the present payload."""
        entry, epoch = self.models.entry, self.arm.epoch
        return entry is not None and self.arm.watch.is_confirmed and (
            not epoch.is_open or entry.epoch == epoch.number)

    def _ended(self, job: Pending, answer: Failed | Result, now: float) -> None:
        """Handle the result or failure of a job."""
        if isinstance(answer, Failed):
            self._failed(job, answer)
        elif isinstance(answer, str):
            job.reply(True, answer)
        elif job.origin != (self.arm.epoch, self.models.entry):
            job.reply(False, 'payload_changed or rollback was called during the fit; its result '
                      'was discarded')
        elif isinstance(answer, FitResult):
            self._fit_ended(job, answer, now)
        else:
            self._payload_tested(answer, now)

    def _failed(self, job: Pending, failure: Failed) -> None:
        """
        Report a job without a result.

        A state of learning is a lost fit, and a failed one that no call waits for.
        """
        text = f'{failure.reason}; {self.kept}'
        if job.kind == FIT:
            self.last_fit = f'failed: {failure.reason}'
            if failure.is_lost or job.call is None:
                self.state, self.report = FAULTY, text
        job.reply(False, text)
        self._events.log.append((True, text))

    @property
    def kept(self) -> str:
        """The model in use after a refusal, as text."""
        return 'no model yet' if self.models.model is None else 'the old model stays in use'

    def _payload_tested(self, result: PayloadResult, now: float) -> None:
        """Report a new suspicion; open an epoch with `on_suspected_payload: learn`."""
        self._events.checks.append(to_json('payload', result.text, result.checks))
        if not self.arm.watch.add_finding(result):
            return
        self._events.payloads.append(result)
        self._events.log.append((True, result.text))
        if self.arm.settings.on_suspected_payload == LEARN:
            success, text = self.payload_changed(now)
            self.report = f'opened automatically: {result.text}'
            self._events.log.append((not success, text))

    def _fit_ended(self, job: Pending, result: FitResult, now: float) -> None:
        """Use or refuse the model of a fit; reply, log, and publish its checks."""
        # Without any model further motion may still give the first one.
        if result.accepted or (self.models.model is not None and not result.fault):
            self.arm.epoch.fit_succeeded()
        # Friction at the start of a motion causes a single outlier.
        outliers = ', '.join(f'{n} of {name}' for name, n in result.outliers.items() if n > 1)
        left_out = f' (without outliers: {outliers})' if outliers else ''
        self.last_fit = fit = (
            f'{result.how}, {result.model.coverage.n_samples} samples{left_out}, '
            f'{result.seconds:.2f} s: {result.reason}')
        self.last_checks = result.checks
        text = f'{"new model in use" if result.accepted else self.kept}: {fit}'
        if result.accepted:
            self.state, self.report = (REFUSED, f'samples left out as outliers: {outliers} (an '
                                       'intermittent brake, or a contact with the arm)'
                                       ) if outliers else (FINE, '')
            self._use(result, now)
        elif result.has_no_gravity:
            self.state, self.report = REFUSED, fit
        elif result.fault:
            self.state, self.report = FAULTY, f'broken effort: {fit}'
        else:
            self.state, self.report = REFUSED, f'old model kept: {fit}'
        job.reply(result.accepted, text)
        figures = '; '.join(check.describe() for check in result.checks)
        self._events.log.append((not result.accepted, f'{text} [{figures}]'))
        self._events.checks.append(to_json('model', text, result.checks))
        if result.fault or result.has_no_gravity:
            self._refuse(result, now)

    def _use(self, result: FitResult, now: float) -> None:
        """Take a new model into use."""
        epoch, model = self.arm.epoch, result.model
        self.models.use(model, result.numbers, f'{result.how} in epoch {epoch.number}', now,
                        epoch.number)
        past = self.models.past
        self.arm.use(model, past[-1].model if past else None, model.coverage.n_samples)
        self.models.problem = ''
        self._save()

    def _save(self) -> None:
        """Write the model in use with `auto_save`: a restart must not use another one."""
        if self.arm.settings.auto_save and self.models.path:
            self.models.save(lambda success, text: self._events.log.append((not success, text)))

    def _refuse(self, result: FitResult, now: float) -> None:
        """Record broken effort; roll back an unconfirmed model of it, and drop its samples."""
        entry, why, epoch = self.models.entry, result.fault or result.reason, self.arm.epoch
        if entry is not None and entry.epoch == epoch.number and self.models.past and (
                not self.arm.watch.is_confirmed):
            self.roll_back(now, why)
            return
        if len(epoch) >= FULL_FIT_SAMPLES and epoch.is_open and not result.has_no_gravity:
            epoch.restart(after_fault=True)
            self.report += '; its samples were dropped'

    def payload_changed(self, now: float) -> tuple[bool, str]:
        """Open a new epoch: drop the samples; keep the model in use until a better one exists."""
        dropped, was_open = len(self.arm.epoch), self.arm.epoch.is_open
        number = self.arm.epoch.number + (dropped > 0 or not was_open)
        # Also in an open epoch without samples: a sample may wait, and the payload may swing.
        self.arm.new_epoch(number, now, self.models.model)
        self.state, self.report = FINE, ''
        if was_open and not dropped:
            return True, f'{self.arm.epoch.describe()}; it was open already'
        return True, (f'epoch {self.arm.epoch.number} open, {dropped} old samples dropped; '
                      f'{self.kept} until a better one is learned: move the arm slowly '
                      'through its range')

    def roll_back(self, now: float, fault: str = '') -> tuple[bool, str]:
        """
        Bring back the last model of the previous payload.

        No automatic fit follows, but after a `fault` of the effort samples are collected again.
        """
        entry, epoch = self.models.roll_back(now), self.arm.epoch
        if entry is None:
            return False, 'there is no model of an earlier payload to roll back to'
        self.arm.use(entry.model, None, 0)
        self._save()
        epoch.is_open = epoch.is_open and bool(fault)
        if fault:
            epoch.base = entry.model
            epoch.restart(after_fault=True)
            self.last_fit = f'rolled back automatically to the {entry.describe()}: {fault}'
            self.state, self.report = FAULTY, f'broken effort: {self.last_fit}'
            self._events.log.append((True, self.last_fit))
        return True, (f'rolled back to the {entry.describe()}, of the previous payload; models of '
                      f'{len(self.models.past)} earlier payloads remain; no fit until '
                      'payload_changed or refit is called')

    def request(self, kind: str, wall: float, reply: Reply) -> None:
        """Queue a job of this kind; `reply` is called once, now or at its end."""
        job = self.fits.job
        if self._queued is not None or (job is not None and job.kind != PAYLOAD):
            reply(False, f'a fit is running already ({self.fits.seconds(wall):.1f} s); its '
                  'result will be in /diagnostics')
        elif (missing := self.arm.epoch.missing_for_fit()) is not None:
            reply(False, missing)
        else:
            self.has_started = True
            self._queued = Pending(kind, reply, wall + self.arm.settings.refit_timeout)

    def _expire(self, wall: float) -> None:
        """Reply to calls past their deadline."""
        queued, running = self._queued, self.fits.job
        if queued is not None and wall > queued.until:
            self._queued = None
            queued.reply(False, f'the fit process is {self.fits.state}: '
                         f'{self.fits.last_loss or "no fit has started"}; try again')
        if running is not None and wall > running.until:
            running.reply(False, 'the fit is still running; its result will be in /diagnostics')

    def close(self) -> None:
        """Reply to pending calls."""
        for job in (self._queued, self.fits.job):
            if job is not None:
                job.reply(False, 'the node shuts down')
        self._queued = None
