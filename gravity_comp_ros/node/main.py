"""Executable `gravity_comp_node`; without ROS it ends with a one-line error."""

from __future__ import annotations

from collections.abc import Sequence
import signal
import sys


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal ends it; return 0, or 1 with one line if it cannot start."""
    # A KeyboardInterrupt during imports may be raised as an error of a library. Until ROS
    # handles signals, Ctrl-C ends the process by the default action.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        from gravity_comp_ros.node.run import run
    except ImportError as problem:
        print(f'gravity_comp_node: {problem}. The node needs ROS 2 Jazzy: run '
              '`source /opt/ros/jazzy/setup.bash` first, or start it from the .venv that '
              '`make venv` makes. The commands work without.',
              file=sys.stderr)
        return 1
    return run(args)


if __name__ == '__main__':
    sys.exit(main())
