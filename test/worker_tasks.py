"""Tasks of worker processes that tests start."""

import time

from gravity_comp_ros.errors import DataError


def doing():
    """Return what does a job: a word, and what it is about."""
    def work(job, tell):
        word, about = job
        if word == 'sleep':
            tell('sleeping', 0.5)
            time.sleep(about)
        elif word == 'refuse':
            raise DataError(about)
        elif word == 'break':
            raise KeyError(about)
        elif word == 'length':
            return len(about)
        return word

    return work


def failing():
    """Fail before the first job."""
    raise SystemExit(4)
