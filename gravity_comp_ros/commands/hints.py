"""Hints of the core, in terms of the command line."""

from gravity_comp_ros.errors import GravityCompError, Hint

HINTS = {
    Hint.SLOW_MOTION: 'record slow motion, raise --max-speed, or pass --all-samples',
    Hint.IN_MODEL: '`gravity_comp add --undo` removes the last addition',
    Hint.NAME_DESCRIPTION: 'name a file with --urdf',
    Hint.HELD_JOINT_MOVES: 'learn it as a joint of the arm (--joints), or give its position '
                           '(--fixed JOINT=VALUE)',
    Hint.INSTALL_EFFECT: 'install the package that provides it, or remove it with '
                         '`gravity_comp add --undo`',
}


def message_of(error: GravityCompError) -> str:
    """Return the message of an error, with its hint."""
    return error.message if error.hint is None else f'{error.message}: {HINTS[error.hint]}'
