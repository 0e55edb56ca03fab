"""
Processor time of plans for a seven-axis arm, in s, and that of the estimate.

    python -m bench.planning.speed
"""

from __future__ import annotations

import sys
import time

from bench.planning.scenes import Scene
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.estimated_model import model_of
from gravity_comp_ros.planning import plan, PlanOptions
from gravity_comp_ros.planning.questions import named_targets

TARGETS = (None, ('coulomb_friction:iiwa_joint_2',), ('coulomb_friction',), ('gravity',),
           ('base_tilt',), ('joint_flexibility:iiwa_joint_2', 'base_tilt', 'gravity'))


def main() -> int:
    """Print targets, processor time and number of parts."""
    old = Scene('iiwa7', 'coulomb_friction', 1, 'one_way', 0).recorded()
    estimated = estimate(old, FitOptions('chain'))
    model = model_of(estimated)
    started = time.process_time()
    estimate(old, FitOptions('chain'), old=model)
    print(f'estimate from the model: {time.process_time() - started:.1f} s')
    for names in TARGETS:
        targets = None if names is None else named_targets(names, old.names)
        started = time.process_time()
        try:
            planned = plan(old, model, targets, PlanOptions(), estimated=estimated)
            result = f'{len(planned.expectations)} effects, {len(planned.parts)} parts'
        except OptionError as problem:
            result = str(problem)
        print(f'{", ".join(names or ("all open",))}: {time.process_time() - started:.1f} s, '
              f'{result}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
