"""
Processor time of plans for a seven-axis arm, in s.

    python -m bench.planning.speed
"""

from __future__ import annotations

import sys
import time

from bench.planning.scenes import Scene
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.planning import plan, PlanOptions
from gravity_comp_ros.planning.targets import named_targets

ASKED = (None, ('coulomb_friction:iiwa_joint_2',), ('coulomb_friction',), ('gravity',),
         ('base_tilt',), ('joint_flexibility:iiwa_joint_2', 'base_tilt', 'gravity'))


def main() -> int:
    """Print what was asked, how many parts came, and the time that it took."""
    old = Scene('iiwa7', 'coulomb_friction', 1, 'one_way', 0).recorded()
    model = fit(slow_samples(old).samples, FitOptions('chain')).model
    diagnosis = diagnose(old, model)
    for asked in ASKED:
        targets = None if asked is None else named_targets(asked, old.names)
        started = time.process_time()
        try:
            found = plan(old, model, targets, PlanOptions(), diagnosis)
            said = f'{len(found.expectations)} effects, {len(found.parts)} parts'
        except OptionError as problem:
            said = str(problem)
        print(f'{", ".join(asked or ("what is open",))}: {time.process_time() - started:.1f} s, '
              f'{said}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
