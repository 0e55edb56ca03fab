"""Tasks of worker processes in tests."""

import time

from gravity_comp_ros.errors import DataError


def doing():
    """Return a job function; a job is a word and a value."""
    def work(job, report):
        word, value = job
        if word == 'sleep':
            report('sleeping', 0.5)
            time.sleep(value)
        elif word == 'refuse':
            raise DataError(value)
        elif word == 'break':
            raise KeyError(value)
        elif word == 'length':
            return len(value)
        return word

    return work


def failing():
    """Fail before the first job."""
    raise SystemExit(4)
