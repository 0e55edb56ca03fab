"""The page: choices at the left, what is missing and the error so far above, views below."""

from __future__ import annotations

from collections.abc import Callable

from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import CheckboxGroup, CustomJS, UIElement
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.estimation.fit import CHOICES
from gravity_comp_ros.report import markup
from gravity_comp_ros.report.page import report_html
from gravity_comp_ros.report.style import DARK, LIGHT, Style
from gravity_comp_ros.report.verdict import largest, verdict
from gravity_comp_ros.report.views.effects import coefficients, label
from gravity_comp_ros.workbench import compare_view, history_view, page_style, widgets
from gravity_comp_ros.workbench.downloads import Downloads, model_text
from gravity_comp_ros.workbench.jobs import Added, described, Learned, Read, WasRead
from gravity_comp_ros.workbench.live_view import Follower, LiveView
from gravity_comp_ros.workbench.session import Session
from gravity_comp_ros.workbench.views import element, NAMES, Views
from gravity_comp_ros.workbench.worker import Failed, Finished, Progressed, Worker
from jinja2 import Template

_POLL_MS = 100
COMPARE, LIVE = 'Two models', 'Live'
_MOST_ROWS = 12


class Page:
    """One browser window's page: its session, its worker, and what it shows."""

    def __init__(self, document: Document, session: Session, worker: Worker, read: Read | None,
                 follower: Follower | None) -> None:
        self.document, self.session, self.worker = document, session, worker
        self.style: Style = LIGHT
        self.views: Views | None = None
        self.view = LIVE if read is None else NAMES[0]
        self.trouble = ''
        self.live = LiveView(follower, self.style) if follower else None
        self.names = [*(NAMES if read else ()), *([COMPARE] if read else ()),
                      *([LIVE] if follower else ())]
        self._build(read is not None)
        if read is not None:
            self.worker.ask(read)
        self._say()
        document.add_periodic_callback(self._tick, _POLL_MS)

    def close(self) -> None:
        """End the work of this page."""
        self.worker.close()

    # What the page is made of.

    def _build(self, has_bags: bool) -> None:
        self.verdict, self.status = widgets.html('', 'verdict'), widgets.html('', 'status')
        self.cancel = widgets.button('Cancel', self._cancel, name='cancel', visible=False,
                                     width=90)
        self.downloads = Downloads()
        self.side = column(sizing_mode='stretch_width', name='side')
        self.missing = column(sizing_mode='stretch_width', name='missing')
        self.history = column(sizing_mode='stretch_width', name='history')
        self.shown = column(sizing_mode='stretch_width')
        self.tabs = widgets.tabs(self.names, self._look)
        self.formulation = widgets.select('Formulation', [(c, c) for c in CHOICES],
                                          self.session.formulation, lambda value: None)
        self.runs: CheckboxGroup | None = None
        self.joints: CheckboxGroup | None = None
        self.other = widgets.select('Compare with', [('', '–')], '', self._compare_with)
        self.dark = widgets.button('Dark', self._turn_style, name='style')
        self.dark.js_on_click(CustomJS(code="document.documentElement.classList.toggle('dark')"))
        self._fill_side(has_bags)
        head = column(self.verdict, row(self.status, self.cancel, sizing_mode='stretch_width'),
                      self.downloads.element, name='head', sizing_mode='stretch_width')
        views = column(self.tabs, self.shown, name='views', sizing_mode='stretch_width')
        for root in (head, self.side, self.missing, self.history, views):
            self.document.add_root(root)
        # A string would be taken for blocks of Bokeh's own page.
        self.document.template = Template(page_style.TEMPLATE)
        self.document.title = 'gravity_comp workbench'
        self.document.js_on_event('document_ready', CustomJS(
            code="document.documentElement.dataset.ready = 'yes'"))
        self._show_live_or_words()
        self._show_missing()
        self._show_history()

    def _fill_side(self, has_bags: bool) -> None:
        parts: list[UIElement] = [self.dark]
        read = self.session.read
        if has_bags and read is not None:
            choice = self.session.choice
            names = [report.path.name for report in read.reports]
            self.runs = widgets.boxes(names, self._choices_changed)
            self.runs.active = list(choice.runs)
            self.joints = widgets.boxes(read.samples.names, self._choices_changed)
            self.joints.active = [read.samples.names.index(name) for name in choice.joints]
            learn = widgets.button('Learn with these choices', self._learn, name='learn')
            parts += [widgets.html('<h3>Runs</h3>'), self.runs, widgets.html('<h3>Joints</h3>'),
                      self.joints, self.formulation, learn, self.other,
                      widgets.html('<h3>Export</h3>'),
                      widgets.button('Save the model', self._export_model, name='export-model'),
                      widgets.button('Save a report', self._export_report, name='export-report'),
                      widgets.button('Save command lines', self._export_commands,
                                     name='export-commands')]
        self.side.children = parts

    # What happens.

    def _tick(self) -> None:
        for event in self.worker.poll():
            if isinstance(event, Progressed):
                self._say(event)
            elif isinstance(event, Finished):
                self._finished(event)
            elif isinstance(event, Failed):
                self._failed(event)
        if self.live is not None:
            self.live.update(self.view == LIVE)

    def _finished(self, event: Finished) -> None:
        answer, session = event.answer, self.session
        self.trouble = ''
        try:
            if isinstance(answer, WasRead):
                session.take(answer)
                self._fill_side(True)
            elif isinstance(answer, Learned):
                session.learned(answer)
            elif isinstance(answer, Added):
                session.added(answer)
            elif isinstance(answer, Diagnosis):
                session.diagnosed(answer)
        except GravityCompError as problem:
            self._fail(str(problem))
            return
        self._go_on()
        self._refresh()

    def _failed(self, event: Failed) -> None:
        self._fail(f'{described(event.job)} was cancelled' if event.cancelled else event.reason)

    def _go_on(self) -> None:
        job = None if self.worker.busy else self.session.next_job()
        if job is not None:
            self.worker.ask(job)

    def _cancel(self) -> None:
        for event in self.worker.cancel():
            if isinstance(event, Failed):
                self._failed(event)

    def _choices_changed(self) -> None:
        self._say()

    def _learn(self) -> None:
        read = self.session.read
        if read is None or self.runs is None or self.joints is None:
            return
        runs = tuple(sorted(self.runs.active))
        joints = tuple(read.samples.names[k] for k in sorted(self.joints.active))
        if not runs or not joints:
            self._fail('choose at least one run and one joint')
            return
        self.worker.cancel()
        self.session.choose(runs, joints, self.formulation.value)
        self.trouble = ''
        self._go_on()
        self._refresh()

    def _add(self, target: str) -> None:
        try:
            job = self.session.adding((target,))
        except GravityCompError as problem:
            self._fail(str(problem))
            return
        if self.worker.busy:
            # A diagnosis of what is about to change would be of no use.
            self.worker.cancel()
        self.trouble = ''
        self.worker.ask(job)
        self._say()
        self._show_missing()

    def _undo(self) -> None:
        self.worker.cancel()
        try:
            name = self.session.undo()
        except GravityCompError as problem:
            self._fail(str(problem))
            return
        self.trouble = ''
        self._go_on()
        self._refresh()
        self._say(done=f'{name} taken back')

    def _look(self, number: int) -> None:
        self.view = self.names[number]
        self._show_view()

    def _compare_with(self, value: str) -> None:
        if value and COMPARE in self.names:
            self.tabs.active = self.names.index(COMPARE)
            self._show_view()

    def _turn_style(self) -> None:
        self.style = DARK if self.style is LIGHT else LIGHT
        self.dark.label = 'Light' if self.style is DARK else 'Dark'
        if self.live is not None:
            self.live.dress(self.style)
        self._refresh()

    # What is shown.

    def _fail(self, reason: str) -> None:
        self.trouble = reason
        self._say()
        self._show_missing()
        if self.session.stage is None:
            self._show_live_or_words()

    def _say(self, event: Progressed | None = None, done: str = '') -> None:
        job = self.worker.running
        self.cancel.visible = job is not None
        if job is not None:
            stage = f': {event.stage}' if event else ''
            share = f' <progress max="1" value="{event.share:.2f}"></progress>' if event else ''
            text = f'<p id="doing">{markup.text(described(job) + stage)} …{share}</p>'
        elif self.trouble:
            text = f'<p id="trouble" style="color:var(--warn)">{markup.text(self.trouble)}</p>'
        else:
            text = f'<p id="idle" class="quiet">{markup.text(done or "Ready")}</p>'
        if self.status.text != text:
            self.status.text = text

    def _refresh(self) -> None:
        self._make_views()
        self._say()
        self._show_missing()
        self._show_history()
        self._show_verdict()
        self._offer_others()
        self._show_view()

    def _make_views(self) -> None:
        selected = self.views.selected if self.views else []
        try:
            found = self.session.contents() if self.session.stage else self.session.preview()
            self.views = Views(found, self.style, selected)
        except GravityCompError as problem:
            self.views = None
            if self.session.stage is not None:
                self.trouble = str(problem)

    def _show_verdict(self) -> None:
        if self.views is None:
            self.verdict.text = ''
            return
        if self.session.stage is None:
            self.verdict.text = '<h1>Gravity is being learned. So far the views compare with a ' \
                'constant torque.</h1>'
            return
        found = self.views.contents
        told = verdict(found) if found.diagnosis else f'{largest(found)}.'
        self.verdict.text = f'<h1 id="verdict">{markup.text(told)}</h1>'

    def _show_missing(self) -> None:
        if not self.session.paths:
            self.missing.children = [widgets.html('')]  # a node alone has nothing to add to
            return
        stage = self.session.stage
        parts: list[UIElement] = [widgets.html('<h2>What is missing</h2>')]
        if stage is None:
            parts.append(widgets.html(markup.paragraph('No model yet.', 'quiet')))
        elif stage.diagnosis is None:
            told = ('Not looked for yet.' if self.trouble else
                    'Being looked for; the views below are ready.')
            parts.append(widgets.html(markup.paragraph(told, 'quiet')))
            if self.trouble and not self.worker.busy:
                parts.append(widgets.button('Look for what is missing', self._diagnose,
                                            name='diagnose'))
        else:
            parts += self._findings()
        if stage is not None and stage.model.applied.effects:
            held = ', '.join(e.target for e in stage.model.applied.effects)
            parts.append(widgets.html(f'<p id="held">The model has {markup.text(held)}.</p>'))
        self.missing.children = parts

    def _diagnose(self) -> None:
        self.trouble = ''
        self._go_on()
        self._say()
        self._show_missing()

    def _findings(self) -> list[UIElement]:
        found = self.session.findings()
        if not found:
            return [widgets.html(markup.paragraph(
                'Nothing is missing that this motion could show.'))]
        parts: list[UIElement] = []
        for number, (finding, target) in enumerate(found[:_MOST_ROWS]):
            place = finding.joint or 'whole arm'
            change = (f'{wording.percent(finding.nrmse_before)} → '
                      f'{wording.percent(finding.nrmse_after)} of the range')
            rivals = f'; or rather {", ".join(finding.rivals)}' if finding.rivals else ''
            text = (f'<p><b>{number + 1}. {markup.text(label(finding))}</b> on '
                    f'{markup.text(place)}, {markup.text(finding.verdict)}<br>'
                    f'<span class="quiet">{markup.text(coefficients(finding))}; held-out error '
                    f'{markup.text(change + rivals)}</span></p>')
            entry: list[UIElement] = [widgets.html(text)]
            if target:
                entry.append(widgets.button(
                    f'Add {target}', self._adder(target), 'primary', width=190,
                    disabled=self._adding(), name=f'add-{number}'))
            parts.append(row(*entry, sizing_mode='stretch_width'))
        more = len(found) - _MOST_ROWS
        if more > 0:
            parts.append(widgets.html(markup.paragraph(f'{more} more in the view Effects.')))
        return parts

    def _adder(self, target: str) -> Callable[[], None]:
        return lambda: self._add(target)

    def _adding(self) -> bool:
        return self.worker.busy and hasattr(self.worker.running, 'effects')

    def _show_history(self) -> None:
        stages = self.session.stages
        if not self.session.paths:
            self.history.children = [widgets.html('')]
            return
        parts: list[UIElement] = [widgets.html('<h2>Error so far</h2>'
                                               + history_view.numbers(stages))]
        chart = history_view.chart(stages, self.style)
        if chart is not None:
            parts.append(chart)
        if stages and any(step.previous for step in stages[-1].model.history):
            parts.append(widgets.button('Undo the last addition', self._undo, name='undo'))
        self.history.children = parts

    def _offer_others(self) -> None:
        others = self.session.others()
        options = [('', '–'), *((str(k), name) for k, (name, _) in enumerate(others))]
        self.other.options = options
        if self.other.value not in [value for value, _ in options]:
            self.other.value = ''

    def _show_view(self) -> None:
        if self.view == LIVE and self.live is not None:
            self.shown.children = [self.live.element]
        elif self.views is None:
            self._show_live_or_words()
        elif self.view == COMPARE:
            self.shown.children = [self._comparison()]
        else:
            self.shown.children = [self.views.show(self.view)]

    def _comparison(self) -> UIElement:
        others, stage = self.session.others(), self.session.stage
        if not others or stage is None or self.views is None:
            return widgets.html(markup.paragraph(
                'There is no other model yet: add an effect, or name models with --model.'))
        name, model = others[int(self.other.value or 0)]
        try:
            other = self.session.compared(model)
        except GravityCompError as problem:
            return widgets.html(markup.paragraph(str(problem)))
        return element(compare_view.section(
            f'{stage.name} (now)', self.views.contents.comparison, name, other, self.style))

    def _show_live_or_words(self) -> None:
        if self.view == LIVE and self.live is not None:
            self.shown.children = [self.live.element]
            return
        words_ = self.trouble or 'The views appear as soon as the recordings are read and a ' \
            'model is learned.'
        self.shown.children = [widgets.html(f'<h2 id="words">{markup.text(words_)}</h2>')]

    # What goes out.

    def _export_model(self) -> None:
        if self.session.stage is None:
            self._fail('there is no model yet')
            return
        try:
            self.downloads.give('arm.json', 'application/json',
                                model_text(self.session.stage.model))
        except GravityCompError as problem:
            self._fail(str(problem))

    def _export_report(self) -> None:
        if self.views is None or self.session.stage is None:
            self._fail('there is no model yet')
            return
        self.downloads.give('report.html', 'text/html', report_html(self.views.contents))

    def _export_commands(self) -> None:
        self.downloads.give('workbench.sh', 'text/x-shellscript',
                            '\n'.join(['#!/bin/sh', 'set -e', *self.session.commands(), '']))
