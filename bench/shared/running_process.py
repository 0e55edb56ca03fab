"""Check for running processes."""


def is_running(pid):
    """Return whether a process is running; a zombie is not."""
    try:
        with open(f'/proc/{pid}/stat') as stream:
            return stream.read().rpartition(')')[2].split()[0] != 'Z'
    except OSError:
        return False
