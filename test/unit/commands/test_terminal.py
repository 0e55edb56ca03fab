"""Progress in a log: none for short work, a line for each stage of long work."""

import threading
import time

from gravity_comp_ros.commands import terminal


def lines(capsys, expected):
    """Return the lines on standard error, waiting until they contain `expected`."""
    text, deadline = '', time.monotonic() + 60
    while expected not in text:
        assert time.monotonic() < deadline, text
        text += capsys.readouterr().err
    return text.splitlines()


def test_short_work_is_silent(capsys, monkeypatch):
    monkeypatch.setattr(terminal, '_PROGRESS_DELAY', 3600.0)
    before = threading.active_count()
    with terminal.progress() as report:
        report('read', 0.0)
        report('fit', 0.5)
    assert capsys.readouterr().err == ''
    # Other tests of this process may have left threads that end while this one runs.
    end = time.monotonic() + 10.0
    while threading.active_count() > before and time.monotonic() < end:
        time.sleep(0.01)
    assert threading.active_count() <= before


def test_long_work_prints_the_current_and_each_new_stage(capsys, monkeypatch):
    monkeypatch.setattr(terminal, '_PROGRESS_DELAY', 0.0)
    with terminal.progress() as report:
        report('read [red]a', 0.0)
        assert lines(capsys, 'read') == ['... read [red]a']  # without another report
        report('read [red]a', 0.5)
        report('fit', 0.6)
        report('fit', 0.7)
        assert capsys.readouterr().err == '... fit\n'


def test_nothing_is_shown_after_the_end(capsys, monkeypatch):
    monkeypatch.setattr(terminal, '_PROGRESS_DELAY', 3600.0)
    with terminal.progress() as report:
        report('read', 0.0)
    report._end_silence()   # a timer that fired as it was cancelled
    assert capsys.readouterr().err == ''
