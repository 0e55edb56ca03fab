"""State machine of a worker: submit, cancel, process end and close in every state."""

from pathlib import Path

from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.workbench import job_state
from gravity_comp_ros.workbench.choice import Choice
from gravity_comp_ros.workbench.job_state import Failed, Finished, Jobs, PROCESS_ENDED, State
from gravity_comp_ros.workbench.jobs import Learn, Read
from hypothesis import given, settings, strategies as st
import pytest

READ = Read((Path('run.mcap'),), ReadOptions())
FIRST, SECOND = Learn(Choice((0,), ('a',))), Learn(Choice((0,), ('b',)))

# Reachable states.
STATES = {
    'new': Jobs(),
    'reading': Jobs(State.WORKING, READ, (), READ, False),
    'reading, one waits': Jobs(State.WORKING, READ, (FIRST,), READ, False),
    'ready': Jobs(State.IDLE, None, (), READ, True),
    'working': Jobs(State.WORKING, FIRST, (), READ, True),
    'working, one waits': Jobs(State.WORKING, FIRST, (SECOND,), READ, True),
    'after a kill': Jobs(State.IDLE, None, (), READ, False),
    'restoring': Jobs(State.RESTORING, None, (FIRST,), READ, False),
    'closed': Jobs(State.CLOSED),
}
EACH = pytest.mark.parametrize('name', list(STATES))


def lost_in(jobs):
    return [job for job in (jobs.job, *jobs.waiting) if job is not None]


@EACH
@pytest.mark.parametrize('end, reason, cancelled', [
    (job_state.cancelled, 'cancelled', True), (job_state.process_ended, PROCESS_ENDED, False)])
def test_after_the_end_of_the_process_every_job_is_answered_and_recordings_are_kept(
        name, end, reason, cancelled):
    before = STATES[name]
    move = end(before)
    assert list(move.events) == [Failed(job, reason, cancelled) for job in lost_in(before)]
    if name == 'closed':
        assert move.jobs == before
        return
    assert move.jobs.state is State.IDLE and move.jobs.recordings == before.recordings
    assert move.send is None
    if lost_in(before) or end is job_state.process_ended:
        assert move.end and not move.jobs.recordings_read
    else:
        # No job was running: the process is kept.
        assert not move.end and move.jobs == before
    # The next job first reads the last recordings again.
    after = job_state.submitted(move.jobs, SECOND)
    if before.recordings is None:
        assert after.events == (Failed(SECOND, 'no recording has been read'),)
    elif move.jobs.recordings_read:
        assert after.send == SECOND
    else:
        assert after.send == READ and after.jobs.current == SECOND
        done = job_state.answered(after.jobs, 'samples')
        assert done.send == SECOND and done.jobs.state is State.WORKING and not done.events
        assert job_state.answered(done.jobs, 'model').events == (Finished(SECOND, 'model'),)


@EACH
def test_a_second_cancel_changes_nothing(name):
    once = job_state.cancelled(STATES[name]).jobs
    twice = job_state.cancelled(once)
    assert twice.jobs == once and not twice.events and not twice.end


@EACH
def test_closed_is_final(name):
    move = job_state.closed(STATES[name])
    assert move.end and move.jobs.state is State.CLOSED and not move.events
    again = job_state.submitted(move.jobs, FIRST)
    assert again.send is None and isinstance(again.events[0], Failed)
    assert job_state.answered(move.jobs, 'late') == job_state.Transition(move.jobs)


@EACH
def test_a_failed_reading_is_reported_and_can_be_repeated(name):
    jobs = job_state.cancelled(STATES[name]).jobs
    move = job_state.submitted(jobs, READ)
    if name == 'closed':
        return
    failed = job_state.answered(move.jobs, None, 'the file is cut')
    assert failed.events == (Failed(READ, 'the file is cut'),)
    assert job_state.submitted(failed.jobs, READ).send == READ


def test_a_failed_restoring_fails_all_waiting_jobs():
    jobs = job_state.submitted(STATES['restoring'], SECOND).jobs
    move = job_state.answered(jobs, None, 'the file is gone')
    assert [event.job for event in move.events] == [FIRST, SECOND]
    assert all(event.reason == 'the file is gone' for event in move.events)
    assert move.jobs.state is State.IDLE


_EVENTS = st.lists(st.sampled_from(['read', 'ask', 'done', 'fail', 'die', 'cancel']), max_size=40)


@settings(max_examples=300, deadline=None)
@given(_EVENTS)
def test_every_job_ends_once_and_none_works_without_recordings(events):
    jobs, submitted, ended = Jobs(), 0, 0
    for event in events:
        if event in ('read', 'ask'):
            submitted += 1
            move = job_state.submitted(jobs, READ if event == 'read' else FIRST)
        elif event == 'done':
            move = job_state.answered(jobs, 'answer')
        elif event == 'fail':
            move = job_state.answered(jobs, None, 'why')
        else:
            move = job_state.process_ended(jobs) if event == 'die' else job_state.cancelled(jobs)
        jobs = move.jobs
        ended += len(move.events)
        assert submitted - ended == len(lost_in(jobs))
        if jobs.state is State.WORKING and jobs.job is FIRST:
            assert jobs.recordings_read and jobs.recordings is READ
        # A job runs whenever a job waits, so no page waits forever.
        assert (jobs.state is State.IDLE) == (jobs.current is None)
        if move.send is not None:
            assert jobs.state in (State.WORKING, State.RESTORING)
