"""Verbs of the command line, run in the process of a test."""

import json

from gravity_comp_ros.cli import main


def run_json(capsys, *argv):
    """Return the JSON document of a verb that succeeds."""
    capsys.readouterr()
    status = main([*map(str, argv), '--json'])
    out = capsys.readouterr()
    assert status == 0, out.err
    return json.loads(out.out)


def refused(capsys, *argv, status=1):
    """Return the one line of a verb that fails with this status, and prints nothing else."""
    capsys.readouterr()
    assert main(list(map(str, argv))) == status
    out = capsys.readouterr()
    lines = [line for line in out.err.splitlines() if not line.startswith('... ')]
    assert out.out == '' and len(lines) == 1, out
    return lines[0]
