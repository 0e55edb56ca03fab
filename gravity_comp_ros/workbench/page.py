"""The page of a session, as HTML by place: state, findings, history, settings; its requests."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
import secrets

from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.facts.fact import Action
from gravity_comp_ros.models.model_file import model_text
from gravity_comp_ros.planning.trajectory_files import to_yaml
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.contents import Contents
from gravity_comp_ros.report.page import report_html
from gravity_comp_ros.report.views.summary import headline
from gravity_comp_ros.workbench import panels, settings
from gravity_comp_ros.workbench.jobs import ReadResult
from gravity_comp_ros.workbench.results import Results
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.widgets import button, select


class Page:
    """
    The page of a session.

    `contents` are those of the views, None before the recordings are read; `key` is another text
    for others.
    """

    def __init__(self, session: Session) -> None:
        self.session, self.results = session, Results(session)
        self.contents: Contents | None = None
        self.key = ''

    @property
    def tag(self) -> str:
        """Return a word, which any address contains unchanged, for everything that is shown."""
        session = self.session
        state = session.version, str(session.worker.job), session.progress, self.results.other
        return sha256(repr(state).encode()).hexdigest()

    def parts(self) -> dict[str, str]:
        """Return the HTML of each place of the page, and the `key` of the views."""
        session, results = self.session, self.results
        reason = ''
        try:
            contents = results.contents()
            if contents is not self.contents:
                self.contents, self.key = contents, secrets.token_hex(4)
        except GravityCompError as problem:
            reason = session.error or str(problem)
            if session.read is None:
                self.contents, self.key = None, ''
        return {
            'verdict': f'<h1>{markup.text(self._verdict())}</h1>', 'status': status_html(results),
            'missing': panels.findings_html(results), 'history': panels.history_html(results),
            'facts': facts_html(session.read) if session.read else '',
            'settings': settings.form_html(session) if session.read else '',
            'compare': self._other(), 'reason': markup.text(reason), 'key': self.key}

    def act(self, what: str, value: str, form: Mapping[str, Sequence[str]]) -> None:
        """
        Do what an element of the page requests.

        :param form: values of the settings by name.
        :raises GravityCompError: if a value is invalid.
        :raises KeyError: if there is no such request.
        """
        session = self.session
        actions: Mapping[str, Callable[[], None]] = {
            'cancel': session.cancel, 'again': session.try_again,
            'add': lambda: session.add(tuple(value.split(','))),
            'plan': lambda: session.request_plan((value,) if value else None),
            'stage': lambda: session.select_stage(int(value)),
            'other': lambda: setattr(self.results, 'other', value),
            'record': lambda: session.add_recording(Path(form['recording'][0]).expanduser()),
            'learn': lambda: session.learn(settings.choice_of(session, form)),
            'evaluate': lambda: session.evaluate(settings.choice_of(session, form))}
        actions[what]()

    def file(self, name: str) -> Callable[[], str]:
        """
        Return the function that makes a file for download.

        :raises KeyError: if there is no such file now.
        """
        stage, plan, contents = self.session.stage, self.session.plan, self.contents
        files: dict[str, Callable[[], str]] = {}
        if stage is not None:
            files['arm.json'] = lambda: model_text(stage.model)
            files['workbench.sh'] = lambda: '\n'.join(
                ['#!/bin/sh', 'set -e', *self.session.commands(), ''])
            if contents is not None:
                files['report.html'] = lambda: report_html(contents)
        if plan is not None:
            sentences = [part.sentence for part in plan.parts]
            files['motion.yaml'] = lambda: to_yaml(plan.trajectory, sentences)
            files['goal.yaml'] = lambda: to_yaml(plan.trajectory, sentences, True)
        return files[name]

    def _verdict(self) -> str:
        if self.contents is None:
            return 'gravity_comp workbench'
        if self.session.stage is not None:
            return markup.units(headline(self.contents))
        if self.session.error:
            return 'No model yet. The views compare with a constant torque.'
        return 'Gravity is being fitted. The views compare with a constant torque.'

    def _other(self) -> str:
        """Return the selector of the model to compare with."""
        stage, others = self.session.stage, self.results.others()
        first = 'the stage before' if stage is not None and stage.effects else 'no model'
        return select('Compare with', 'other', [('', first), *((name, name) for name in others)],
                      self.results.other, 'other') if others else ''


def status_html(results: Results) -> str:
    """Return the running job, the error, or the last result, with warnings and buttons."""
    session = results.session
    job, event = session.worker.job, session.progress
    # A fit of all samples and the settings may give the same warning: show it once.
    warnings = dict.fromkeys(filter(None, (
        session.warning, results.slow_warning(),
        *(session.stage.warnings if session.stage else ()))))
    below = ''.join(f'<p class="warning">{markup.text(text)}</p>' for text in warnings)
    if job is not None:
        stage = f': {event.stage}' if event else ''
        share = f' <progress max="1" value="{event.share:.2f}"></progress>' if event else ''
        return (f'<p id="doing">{markup.text(str(job) + stage)} …{share} '
                f'{button("Cancel", "cancel")}</p>{below}')
    if session.error:
        again = button('Try again', 'again', kind='primary') if session.next_job() else ''
        return f'<p id="trouble" class="warning">{markup.text(session.error)} {again}</p>{below}'
    return f'<p id="idle" class="quiet">{markup.text(session.done or "Ready")}</p>{below}'


def facts_html(read: ReadResult) -> str:
    """Return the facts of each recording, and of all together, a line each; '' without facts."""
    lines = [(f'{report.path.name}:', fact) for report in read.reports for fact in report.facts]
    lines += [('', fact) for fact in read.facts]
    if not lines:
        return ''
    listed = ''.join(
        f'<li class="{"warning" if fact.action is Action.REFUSED else "quiet"}">'
        f'{markup.text(name)} {"refused: " * (fact.action is Action.REFUSED)}'
        f'{markup.text(fact.sentence)}</li>' for name, fact in lines)
    return f'<details open><summary>Facts of the recordings ({len(lines)})</summary>' \
           f'<ul>{listed}</ul></details>'
