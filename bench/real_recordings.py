"""
The loop on recordings of real arms: fit, diagnose, add, each judged on motion that came later.

Run from the root of the repository:

    python3 bench/real_recordings.py ur10.db3 panda.db3

The first 70 % of each recording are fitted and diagnosed, the last 30 % are compared. Errors are
RMSE over the standard deviation of the torque, in percent, joint by joint: of the default fit, of
that with what the diagnosis found, and with the best of each tie as well.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import gravity_comp_ros as gc
from gravity_comp_ros.models.applied_effects import target
import numpy as np

_FITTED = 0.7


def main() -> int:
    """Run the loop on each recording and print the errors."""
    parser = argparse.ArgumentParser(description='The loop on recordings of real arms.')
    parser.add_argument('bags', nargs='+', metavar='BAG')
    for bag in parser.parse_args().bags:
        data = gc.read(bag)
        t = data.samples.t
        split = t[0] + _FITTED * (t[-1] - t[0])
        early = gc.Recording(data.samples.select(t < split))
        later = gc.Recording(data.samples.select(t >= split), gate=None)
        model = gc.fit(early)
        show(f'{bag}: fit', model, later)
        found = gc.diagnose(gc.Recording(early.samples, gate=None), model).findings
        for finding in found:
            print(f'    {finding.effect or "unexplained"} on {finding.joint or "the arm"}: '
                  f'{finding.verdict}')
        sure = [f for f in found if f.verdict in (gc.Verdict.ESTABLISHED, gc.Verdict.LIKELY)]
        ties = [f for f in found if f.verdict == gc.Verdict.AMBIGUOUS]
        for words, chosen in (('found', sure), ('and ties', [*sure, *ties])):
            show(words, added(model, early, chosen), later)
    return 0


def added(model: gc.Model, recording: gc.Recording, findings: Sequence[gc.Finding]) -> gc.Model:
    """Return the model with findings added to it, on all samples."""
    targets = [target(f.effect, f.joint) for f in findings if f.effect]
    return gc.add_effects(model, recording, targets, all_samples=True) if targets else model


def show(words: str, model: gc.Model, recording: gc.Recording) -> None:
    """Print the errors of a model."""
    joints = gc.compare(model, recording).joints.values()
    shares = [100.0 * joint.rmse / max(joint.torque_std, 1e-12) for joint in joints]
    print(f'{words}:', ' '.join(f'{share:.0f}' for share in np.array(shares)), '%', flush=True)


if __name__ == '__main__':
    raise SystemExit(main())
