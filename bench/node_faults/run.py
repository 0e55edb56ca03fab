#!/usr/bin/env python3
"""
Faults fired at the running node over DDS, each published torque judged against the truth.

    python3 bench/node_faults/run.py [--seeds 1] [--only TEXT] [--axes]

With one seed these are 42 recordings of broken effort (14 kinds, 3 lengths), 20 real payloads (ten
seeds, on and off the axis), 4 with a brake that grips now and then, 3 that the node is not told
of, ten minutes of touches, 3 arms led by hand and 15 faults of input, clock and pauses; with three
seeds 126 of the first. `--axes` gives the node
the URDF of the arm. A fault fails where a torque is over 1 N·m further from the truth than the
model before, where a step breaks the rate, where a model of broken effort is in use at its end, or
where the node does not say what is wrong.
"""

from __future__ import annotations

import argparse
from itertools import groupby
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.recordings.bag import read_bag

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(ROOT / 'test')]


def fire(faults: list[Any], path: Path, description: str) -> list[str]:
    """Fire faults at one process; return what went wrong."""
    from client import describe, PARAMETERS, Player
    from ros_harness import running
    failed = []
    parameters = {**PARAMETERS, 'model_file': path, **faults[0].parameters}
    with running(parameters) as (node, probe):
        if description and parameters.get('robot_description') != 'off':
            describe(probe, description)
        for fault in faults:
            start = time.monotonic()
            player = Player(probe, load_model(path))
            problem = fault.play(player)
            player.judge(fault.name, fault.ramps)
            if node.process.poll() is not None:
                problem = 'the node died'
            lines = [*([problem] if problem else []), *player.wrong[:3]]
            print(f'{"FAILED" if lines else "ok    "} {time.monotonic() - start:5.1f} s '
                  f'{player.judged:5} torques  {fault.name} {" | ".join(lines)}', flush=True)
            failed += [f'{fault.name}: {line}' for line in lines]
            back_to_start(probe, player)
    return failed


def back_to_start(probe, player) -> None:
    """Go back to the model that the node began with, and let its torque take over."""
    while probe.call('rollback').success:
        pass
    player.carry(None)
    player.move(30)
    # What is learned of the bare arm is learned before the next fault begins.
    player.settle()
    probe.torques.clear()


def main() -> int:
    from faults import every_fault
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--only', default='')
    parser.add_argument('--axes', action='store_true')
    args = parser.parse_args()
    faults = [fault for fault in every_fault(args.seeds) if args.only in fault.name]
    description = (ROOT / 'bags' / 'iiwa7.urdf').read_text() if args.axes else ''
    failed: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'model.json'
        bare = read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples
        save_model(path, fit(bare, FitOptions(formulation='chain')).model)
        for _, group in groupby(faults, key=lambda fault: sorted(
                (name, str(value)) for name, value in fault.parameters.items())):
            failed += fire(list(group), path, description)
    print(f'{len(faults)} faults, {len(failed)} failures')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
