"""Learning: submits jobs to the fit process, and takes models into use or rolls them back."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import partial

from gravity_comp_ros.node.arm import Arm
from gravity_comp_ros.node.checks import (
    Check, ERROR, FIT, FitResult, Job, OK, PAYLOAD, PayloadResult, Result, to_json, WARN)
from gravity_comp_ros.node.epoch import Epoch, FULL_FIT_SAMPLES, rows_of
from gravity_comp_ros.node.model_history import Entry, ModelHistory, Reply
from gravity_comp_ros.node.watch import LEARN
from gravity_comp_ros.worker.worker_process import Done, Failed, Worker


@dataclass
class Pending:
    """
    A job without an answer: its kind, when it was requested (s), and the call that waits for it.

    Its result is discarded if `epoch` and model have changed since.
    """

    kind: str
    since: float
    epoch: Epoch
    entry: Entry | None
    call: Reply | None = None

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

    def __init__(self, arm: Arm, models: ModelHistory, fits: Worker, events: Events) -> None:
        self.arm, self.models, self.fits, self._events = arm, models, fits, events
        # The checks of the last decision about a model.
        self.last_checks: tuple[Check, ...] = ()
        # The last fit as text, and what diagnostics report about it.
        self.last_fit = 'none'
        self.level, self.report = OK, ''
        self.has_started = False

    def poll(self, now: float, wall: float) -> None:
        """
        Handle jobs of the fit process that have ended, and start the next job.

        :param wall: wall-clock time in s for timeouts, where `now` is simulated time.
        """
        for job, message in self.fits.poll():
            if isinstance(message, Failed):
                self._failed(job, message)
            elif isinstance(message, Done):
                self._ended(job, message.answer, now)
        self._expire(wall)
        entry = self.models.entry
        # The samples of another payload show no fault of the model.
        judged = (self.arm.watch.model_checks()
                  if entry is not None and entry.epoch == self.arm.epoch.number else [])
        if judged and not any(check.passed for check in judged):
            self._events.checks.append(to_json('rollback', judged[0].text, judged))
            self.roll_back(now, judged[0].text)
        if self.fits.job is not None:
            return
        if self._is_tested() and self.arm.watch.is_due():
            self._start(PAYLOAD, wall)
        elif self.arm.settings.auto_fit and self.arm.epoch.fit_is_due():
            self._start(FIT, wall)

    def request(self, kind: str, wall: float, reply: Reply) -> None:
        """Start a job of this kind; `reply` is called once, now or at its end."""
        running = next((job for job in self.fits.jobs if job.kind != PAYLOAD), None)
        if running is not None:
            reply(False, f'a fit is running already ({wall - running.since:.1f} s); its result '
                  'will be in /diagnostics')
        elif (missing := self.arm.epoch.missing_for_fit()) is not None:
            reply(False, missing)
        else:
            self._start(kind, wall, reply)

    def _start(self, kind: str, wall: float, call: Reply | None = None) -> None:
        """Start a job; another thread prepares its samples."""
        arm = self.arm
        job = partial(Job, kind, model=self.models.model, base=arm.epoch.base,
                      settings=arm.settings, geometry=arm.described.geometry,
                      on_request=call is not None)
        kept = arm.watch.window() if kind == PAYLOAD else arm.epoch.samples()
        if kind == FIT:
            arm.epoch.fit_started()
        self.has_started = True
        self.fits.start(Pending(kind, wall, arm.epoch, self.models.entry, call),
                        lambda: job(rows_of(arm.joints, kept)))

    def _is_tested(self) -> bool:
        """Return whether the model in use is confirmed and of the present payload."""
        entry, epoch = self.models.entry, self.arm.epoch
        return entry is not None and self.arm.watch.is_confirmed and (
            not epoch.is_open or entry.epoch == epoch.number)

    def _ended(self, job: Pending, answer: Result, now: float) -> None:
        """Handle the result of a job."""
        if isinstance(answer, str):
            job.reply(True, answer)
        elif job.epoch is not self.arm.epoch or job.entry is not self.models.entry:
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
                self.level, self.report = ERROR, text
        elif job.kind == PAYLOAD:
            # The next test needs a whole window, so that a process that dies is rarely started.
            self.arm.watch.restart()
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
        self.level, self.report = OK, ''
        if result.fault and not result.has_no_gravity:
            self.level, self.report = ERROR, f'broken effort: {fit}'
        elif not result.accepted:
            self.level, self.report = WARN, text
        elif outliers:
            self.level, self.report = WARN, (
                f'samples left out as outliers: {outliers} (an intermittent brake, or a contact '
                f'with the arm)')
        if result.accepted:
            self._use(result, now)
        job.reply(result.accepted, text)
        figures = '; '.join(check.describe() for check in result.checks)
        self._events.log.append((not result.accepted, f'{text} [{figures}]'))
        self._events.checks.append(to_json('model', text, result.checks))
        if result.fault or result.has_no_gravity:
            self._refuse(result, now)

    def _use(self, result: FitResult, now: float) -> None:
        """Take a new model into use."""
        epoch, model = self.arm.epoch, result.model
        self.models.use(model, f'{result.how} in epoch {epoch.number}', now, epoch.number)
        past = self.models.past
        self.arm.use(model, past[-1].model if past else None, model.coverage.n_samples)
        self._save()

    def _save(self) -> None:
        """
        Write the model in use with `auto_save`: a restart must not use another one.

        A file that could not be loaded stays: it may be the model of another arm.
        """
        if self.arm.settings.auto_save and self.models.path and not self.models.load_problem:
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
        self.level, self.report = OK, ''
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
        epoch.is_open, epoch.base = epoch.is_open and bool(fault), entry.model
        if fault:
            epoch.restart(after_fault=True)
            self.last_fit = f'rolled back automatically to the {entry.describe()}: {fault}'
            self.level, self.report = ERROR, f'broken effort: {self.last_fit}'
            self._events.log.append((True, self.last_fit))
        return True, (f'rolled back to the {entry.describe()}, of the previous payload; models of '
                      f'{len(self.models.past)} earlier payloads remain; no fit until '
                      'payload_changed or refit is called')

    def _expire(self, wall: float) -> None:
        """End a job that hangs."""
        jobs = self.fits.jobs
        if jobs and (waited := wall - jobs[0].since) > self.arm.settings.fit_timeout:
            self.fits.cancel()
            for job in jobs:
                self._failed(job, Failed(f'the fit hung: no result after {waited:.1f} s; its '
                                         'process was killed', is_lost=True))

    def close(self) -> None:
        """Reply to pending calls."""
        for job in self.fits.jobs:
            job.reply(False, 'the node shuts down')
