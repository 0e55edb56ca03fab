"""
Demonstration in two minutes: learn an arm, add a payload of 2 kg, relearn, show the errors.

The node runs in its own process and receives only joint states, over DDS. The last part of each
recording is used for evaluation only: it is played without effort, and the predictions of the
node are compared with the recorded effort.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time

from gravity_comp_ros.commands import terminal
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.evaluation.compare import compare_prediction, Comparison
from gravity_comp_ros.printable import printable
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np
from rich.text import Text
from robot import DemoError, Robot

BAGS = Path(__file__).resolve().parent.parent / 'bags'
UNLOADED, LOADED = 'eq17_unloaded.mcap', 'eq17_2kg.mcap'
# End of the first and of the second training part, and start of the evaluation part, of the 100 s
# of each recording, in s.
FIRST, LEARNED, EVALUATED = 10.0, 75.0, 78.0
# Playback speed, recorded seconds per second.
SPEED = 40.0
FIT_TIMEOUT = 240.0  # s
# Settling time of the node, recorded seconds.
SETTLE_TIME = 0.5
# Minimum change of an RMSE for a remaining error in percent, N·m.
MIN_CHANGE = 0.05


def main() -> int:
    """Run the demo; return 0 if the relearned model is better than the stale one."""
    started = time.monotonic()
    # A separate domain: joint states of the demo must never reach a real arm. Tests use 1-80.
    os.environ['ROS_DOMAIN_ID'] = str(81 + os.getpid() % 20)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    try:
        unloaded, loaded = (read_bag(BAGS / name).samples for name in (UNLOADED, LOADED))
        with tempfile.TemporaryDirectory() as folder, running_node(Path(folder)) as node:
            robot = Robot(unloaded.names, SPEED, lambda: node.poll() is None)
            try:
                columns = run_stages(robot, unloaded, loaded)
            finally:
                robot.close()
    except (DemoError, GravityCompError) as error:
        print(f'demo: {printable(error)}', file=sys.stderr)
        return 1
    terminal.show('', table(columns), *summary(columns), '',
                  f'{time.monotonic() - started:.0f} s in all')
    stale, relearned = columns[1][1], columns[-1][1]
    return 0 if relearned.joints[stale.worst].rmse < stale.joints[stale.worst].rmse else 1


def run_stages(robot: Robot, unloaded: JointSamples,
               loaded: JointSamples) -> list[tuple[str, Comparison]]:
    """Run the stages of the demo; return the title and the errors of each."""
    robot.connect(timeout=20.0)
    show(f'The arm moves slowly without payload ({LEARNED:.0f} s of {UNLOADED}).')
    robot.play(between(unloaded, 0.0, LEARNED))
    call(robot, 'refit')
    first = evaluate(robot, unloaded)

    show(f'A payload of 2 kg is added ({LOADED}) without notice to the node.')
    stale = evaluate(robot, loaded)
    show(f'The feed-forward is wrong: {stale.worst} by {stale.joints[stale.worst].rmse:.2f} N·m.')

    call(robot, 'payload_changed')
    show(f'The arm moves slowly for {FIRST:.0f} s.')
    robot.play(between(loaded, 0.0, FIRST))
    call(robot, 'refit')
    quick = evaluate(robot, loaded)
    show(f'The motion continues up to {LEARNED:.0f} s.')
    robot.play(between(loaded, FIRST, LEARNED))
    call(robot, 'refit')
    return [('no load,\nlearned', first), ('2 kg,\nstale', stale),
            (f'2 kg, after\n{FIRST:.0f} s', quick),
            (f'2 kg, after\n{LEARNED:.0f} s', evaluate(robot, loaded))]


def evaluate(robot: Robot, samples: JointSamples) -> Comparison:
    """Return the errors of the node on the evaluation part of a recording."""
    answered, predicted = robot.predictions(between(samples, EVALUATED, np.inf))
    return compare_prediction(answered, predicted, np.zeros(len(answered), dtype=bool))


def call(robot: Robot, service: str) -> None:
    """Call a service of the node, and show its message."""
    success, message = robot.call(service, FIT_TIMEOUT)
    show(f'{service}: {message}', 'green' if success else 'yellow')


def between(samples: JointSamples, start: float, end: float) -> JointSamples:
    """Return the samples with start <= t < end, in s."""
    return samples.select((samples.t >= start) & (samples.t < end))


def show(text: str, style: str = '') -> None:
    """Show a line of plain text."""
    terminal.show(Text('• ' + printable(text), style=style))


def table(columns: list[tuple[str, Comparison]]) -> TextTable:
    """Return a table of the errors of each joint at each stage."""
    stale, last = columns[1][1], columns[-1][1]
    rows = []
    for joint in stale.joints:
        before, after = stale.joints[joint].rmse, last.joints[joint].rmse
        remaining = '–' if abs(before - after) < MIN_CHANGE else f'{100 * after / before:.0f} %'
        row = [joint, *(f'{errors.joints[joint].rmse:.3f}' for _, errors in columns), remaining]
        rows.append(row)
    return TextTable(('joint', *(title for title, _ in columns), 'remaining error'), rows,
                     'RMSE of the predictions in N·m, on motion that was not fitted')


def summary(columns: list[tuple[str, Comparison]]) -> list[str]:
    """Return a summary of the table: the worst joint before and after relearning."""
    stale, last = columns[1][1], columns[-1][1]
    worst = stale.worst
    now = last.joints[last.worst].rmse
    return [
        f'Worst joint with the stale model: {worst}, {stale.joints[worst].rmse:.2f} N·m; after '
        f'relearning {last.joints[worst].rmse:.2f} N·m.',
        f'Worst joint after relearning: {last.worst}, {now:.2f} N·m. The recordings contain '
        '0.1 N·m of noise (bags/make.sh), which is a lower bound of the error.']


@contextmanager
def running_node(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run gravity_comp_node in its own process; on failure show the end of its log."""
    log = folder / 'node.log'
    command = [sys.executable, '-m', 'gravity_comp_ros.node.main', '--ros-args',
               '-p', 'auto_fit:=false', '-p', 'max_age:=0.0',
               '-p', f'fit_timeout:={FIT_TIMEOUT}',
               # Playback is faster than real time.
               '-p', f'settle_time:={SETTLE_TIME / SPEED}']
    show(f'Starting the node: {Path(sys.executable).name} {" ".join(command[1:])}')
    with log.open('wb') as stream:
        node = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, cwd=folder)
        try:
            yield node
        except DemoError:
            sys.stderr.write(''.join(printable(line) + '\n' for line in log.read_text(
                errors='replace').splitlines()[-15:]))
            raise
        finally:
            node.send_signal(signal.SIGINT)
            try:
                node.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                node.kill()
                node.wait()


if __name__ == '__main__':
    sys.exit(main())
