"""What is learned: jobs for the fit process, and what becomes of their results."""

from __future__ import annotations

from collections import deque

from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.arm import Arm
from gravity_comp_ros.node.diagnostics import Learning
from gravity_comp_ros.node.fit_messages import Findings, Job, Look, Outcome, Question, Seen
from gravity_comp_ros.node.fit_process import Failure, FitProcess
from gravity_comp_ros.node.fit_requests import FitRequests, Reply, Request
from gravity_comp_ros.node.model_history import Models
from gravity_comp_ros.node.options import payload_limits
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.payload_watch import LEARN, Suspicion
from gravity_comp_ros.node.unsure_change import UnsureChange

# After a refusal of broken effort, so many samples are kept in the hope that more tell more; then
# they go, so that effort that has healed is not judged together with what came before.
KEPT_BROKEN = 100


class Learner:
    """
    Starts fits of an arm's samples, takes models into use, and goes back where one is wrong.

    :param news: what happened, for the log: (is it bad news, sentence).
    """

    def __init__(self, settings: Parameters, models: Models, news: deque[tuple[bool, str]]
                 ) -> None:
        self.settings = settings
        self.models = models
        self.fits = FitProcess(settings.fit_timeout)
        self.wants_save = False
        # Payloads that the node was not told of and has not reported yet.
        self.events: deque[Suspicion] = deque(maxlen=10)
        self._news = news
        self.jobs = 0
        # Results of jobs up to this number come too late to be used.
        self._outdated = 0
        self._requests = FitRequests()
        # The model in use when the epoch began: what a new payload changes.
        self._base: GravityModel | None = None
        self._last_fit = 'none'
        # Samples that the last fit left out because something acted for a moment, in words.
        self._outliers = ''
        self._kept_old = self._compensated = self._broken = False

    def begin(self, base: GravityModel | None) -> None:
        """Begin with an arm, and the model that is known of it."""
        self._base = base

    def poll(self, arm: Arm | None, now: float, wall: float) -> None:
        """Take what the fit process has done, and give it what is to be done next."""
        for event in self.fits.poll(wall):
            if isinstance(event, Findings):
                self._requests.reply(event.number, True, event.text)
            elif arm is not None:
                self._ended(arm, event, now)
        if arm is None:
            return
        self._requests.expire(wall, f'{self.fits.state}: '
                              f'{self.fits.last_failure or "no fit has begun"}')
        if self.fits.state == 'ready':
            if self._requests.wanted is not None:
                self._serve(arm, wall)
            elif (model := self._sure_model(arm)) is not None and arm.payload.is_due():
                self._submit_look(arm, model, wall)
            elif self.settings.auto_fit and arm.epoch.fit_is_due():
                self._submit(arm, wall)

    def _ended(self, arm: Arm, event: Outcome | Seen | Failure, now: float) -> None:
        if isinstance(event, Outcome):
            self._finish(arm, event, now)
        elif isinstance(event, Seen):
            self._look_ended(arm, event, now)
        else:
            self._fail(arm, event)

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
        self.jobs += 1
        job = Job(self.jobs, arm.epoch.number, arm.epoch.train(), arm.epoch.held(),
                  self._base, self.models.model, self.settings.formulation,
                  self.settings.effects, asked,
                  payload_limits(self.settings), arm.geometry, arm.epoch.sent())
        self.fits.submit(job, now)
        arm.epoch.fit_started()
        return self.jobs

    def _submit_question(self, arm: Arm, now: float) -> int:
        self.jobs += 1
        self.fits.submit(Question(self.jobs, arm.epoch.every(), self.models.model), now)
        return self.jobs

    def _sure_model(self, arm: Arm) -> GravityModel | None:
        """Return the model in use if it is one of this payload, and predicts it."""
        entry = self.models.entry
        if entry is None or not arm.is_confirmed or (
                arm.epoch.is_open and entry.epoch != arm.epoch.number):
            return None
        return entry.model

    def _submit_look(self, arm: Arm, model: GravityModel, now: float) -> None:
        self.jobs += 1
        self.fits.submit(Look(self.jobs, arm.payload.window(), model,
                              payload_limits(self.settings), arm.geometry), now)

    def _look_ended(self, arm: Arm, seen: Seen, now: float) -> None:
        """Report a payload that is new, and learn it where that is wanted."""
        if seen.number <= self._outdated:
            return
        suspicion = arm.payload.found(seen.finding, seen.since)
        if suspicion is None:
            return
        self.events.append(suspicion)
        self._news.append((True, suspicion.text))
        if self.settings.on_suspected_payload == LEARN:
            success, text = self.payload_changed(arm, now)
            arm.epoch.note = f'opened by itself: {suspicion.text}'
            self._news.append((not success, text))

    def _finish(self, arm: Arm, outcome: Outcome, now: float) -> None:
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
        self._last_fit = (f'{outcome.how}, {outcome.model.coverage.n_samples} samples{left_out}, '
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
        self.models.problem = ''
        self.wants_save = self.settings.auto_save and bool(self.models.path)
        self._tell(outcome.number, True, f'new model in use: {self._last_fit}')

    def _refused(self, arm: Arm, why: str, now: float) -> None:
        """Say that effort is broken; go back if a model was learned from it, and collect anew."""
        entry = self.models.entry
        if entry is not None and entry.epoch == arm.epoch.number and self.models.n_past and (
                not arm.is_confirmed):
            self.roll_back_alone(arm, why, now)
            return
        arm.epoch.note = f'a model was refused: {why}'
        if arm.epoch.n_samples >= KEPT_BROKEN and arm.epoch.is_open and (
                not self._compensated):
            arm.epoch.distrust()
            arm.epoch.note += '; its samples were dropped'

    def _tell(self, number: int, success: bool, text: str) -> None:
        """Answer whoever waits for a job, and the log."""
        self._requests.reply(number, success, text)
        self._news.append((not success, text))

    def _fail(self, arm: Arm, failure: Failure) -> None:
        if failure.number is not None:
            arm.epoch.fit_ended(False)
            self._last_fit = f'failed: {failure.reason}'
            kept = 'there is no model yet' if self.models.model is None else 'the old model stays'
            self._tell(failure.number, False, f'{failure.reason}; {kept}')

    def roll_back_alone(self, arm: Arm, why: str, now: float) -> None:
        """Go back to the last good model by itself, and start to collect again."""
        entry = self.models.roll_back(now)
        if entry is None:
            return
        arm.use(entry.model, None, 0)
        self._outdated = self.jobs
        self._base = entry.model
        arm.epoch.distrust()
        arm.epoch.note = f'rolled back by itself to the {entry.describe()}: {why}'
        self._broken = True
        self._last_fit = arm.epoch.note
        self._news.append((True, arm.epoch.note))

    def payload_changed(self, arm: Arm, now: float) -> tuple[bool, str]:
        """Open a new epoch: old samples go, the model in use stays until a better one is there."""
        if arm.epoch.is_open and arm.epoch.n_samples == 0:
            return True, f'{arm.epoch.describe()}; it was open already'
        old = arm.epoch.n_samples
        arm.new_epoch(now, can_change(self.models.model))
        self._outdated = self.jobs
        self._base = self.models.model
        self._kept_old = self._compensated = self._broken = False
        self._outliers = ''
        model = 'no model yet' if self.models.model is None else 'the old model stays in use'
        return True, (f'epoch {arm.epoch.number} open, {old} old samples dropped; {model} until '
                      'a better one is learned: move the arm slowly through its range')

    def roll_back(self, arm: Arm, now: float) -> tuple[bool, str]:
        """Bring back the last model of the payload before; no fit follows by itself."""
        entry = self.models.roll_back(now)
        if entry is None:
            return False, 'there is no earlier model to go back to: none of an earlier payload'
        arm.use(entry.model, None, 0)
        arm.epoch.is_open = False
        self._outdated = self.jobs
        return True, (f'back to the {entry.describe()}, of the payload before; '
                      f'{self.models.n_past} earlier payloads left; no fit until '
                      'payload_changed or refit')

    def want(self, arm: Arm, wall: float, reply: Reply, is_question: bool) -> None:
        """Fit, or diagnose; `reply` is called once, now or when that has ended."""
        if self._requests.is_busy or isinstance(self.fits.job, (Job, Question)):
            reply(False, f'a fit is running already ({self.fits.seconds(wall):.1f} s); its '
                  'outcome will be in /diagnostics')
        elif (lack := arm.lack()) is not None:
            reply(False, lack)
        else:
            until = wall + self.settings.refit_timeout
            self._requests.want(Request(reply, until, is_question))

    def status(self, arm: Arm) -> Learning:
        """Return the figures of learning for diagnostics."""
        epoch, fits = arm.epoch, self.fits
        return Learning(
            epoch.describe(), epoch.n_samples, epoch.n_held, epoch.lacking(), arm.gate_counts,
            fits.state, fits.restarts, fits.pid, fits.last_failure, self._last_fit,
            self._kept_old, self._compensated, self._broken, arm.fresh_faults(),
            self._outliers)

    def close(self) -> None:
        """End the fit process, and answer whoever waits."""
        self._requests.close()
        self.fits.stop()


def can_change(model: GravityModel | None) -> bool:
    """Return whether a change of this model can be fitted."""
    return model is not None and model.energy is not None
