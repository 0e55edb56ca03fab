"""Whether a process lives, for tests of processes that must end."""


def lives(pid):
    """Return whether there is such a process, one that has ended and waits to be reaped apart."""
    try:
        with open(f'/proc/{pid}/stat') as stream:
            return stream.read().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False
