#!/usr/bin/env python3
"""
Faults injected into the running node over DDS; each published torque is compared with the truth.

    python3 -m bench.node_faults.run [--seeds 1] [--only TEXT] [--arm six]

With one seed these are 42 recordings of broken effort (14 kinds, 3 lengths; 126 with three seeds),
20 real payloads (ten seeds, on and off the axis), 4 with an intermittent brake, 3 unannounced
ones, ten minutes of contacts, 3 arms guided by hand, and 15 faults of input, clock and pauses.
`--arm six` is an arm with six axes instead of an iiwa. A fault fails if a torque error exceeds
that of the old model by more than 1 N·m, a step exceeds the rate limit, a model of broken effort
is in use at the end, or the node does not report the fault.
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


def run_faults(faults: list[Any], path: Path, test_arm: Any) -> list[str]:
    """Inject faults into one process; return the failures."""
    from bench.node_faults.client import PARAMETERS, Player
    from bench.shared.ros_harness import running
    failed = []
    parameters = {**PARAMETERS, 'model_file': path, **faults[0].parameters}
    with running(parameters) as (node, probe):
        for fault in faults:
            start = time.monotonic()
            player = Player(probe, load_model(path), test_arm=test_arm)
            problem = fault.play(player)
            player.check(fault.name, fault.ramps)
            if node.process.poll() is not None:
                problem = 'the node died'
            lines = [*([problem] if problem else []), *player.wrong[:3]]
            print(f'{"FAILED" if lines else "ok    "} {time.monotonic() - start:5.1f} s '
                  f'{player.checked:5} torques  {fault.name} {" | ".join(lines)}', flush=True)
            failed += [f'{fault.name}: {line}' for line in lines]
            restore(probe, player)
    return failed


def restore(probe, player) -> None:
    """Restore the initial model, and wait until its torque is published."""
    while probe.call('rollback').success:
        pass
    player.carry(None)
    player.move(30)
    # Fits of the bare arm must end before the next fault.
    player.finish_fits()
    probe.torques.clear()


def main() -> int:
    from bench.node_faults.arms import ARMS
    from bench.node_faults.faults import all_faults
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--only', default='')
    parser.add_argument('--arm', choices=list(ARMS), default='seven')
    args = parser.parse_args()
    test_arm = ARMS[args.arm]()
    faults = [fault for fault in all_faults(args.seeds) if args.only in fault.name]
    failed: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'model.json'
        save_model(path, fit(test_arm.recording(), FitOptions(formulation='chain')).model)
        for _, group in groupby(faults, key=lambda fault: sorted(
                (name, str(value)) for name, value in fault.parameters.items())):
            failed += run_faults(list(group), path, test_arm)
    print(f'{len(faults)} faults, {len(failed)} failures')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
