"""
Gravity after a payload change, on descriptions of real robots.

Run from the root of the repository:

    python -m bench.real_robots.payloads results/ --seeds 400-401 --jobs 2

A model is fitted to the two training runs of a case (`cases`, without hidden effects; two of three
have LuGre friction). Then a body of 2 to 20 % of the mass of the moving links, with its centre up
to 10 cm from the last joint, is attached, and the arm moves within the same box of poses. The
model is updated with the first 12 s and with 40 s of that motion, without and with the
description of the arm. The error is that of the gravity torque over the trained box: rms of the
worst joint, in percent of the arm's largest gravity torque. The error of the model without an
update shows the size of the change.
"""

from __future__ import annotations

import sys

from bench.real_robots.arms import arm_of, described, urdf
from bench.real_robots.cases import generator, Run, Setting, trained
from bench.real_robots.product import recording
from bench.real_robots.run import arms_and_seeds, each, rms
from bench.shared.runner import extremes, figures, Result, run
import gravity_comp_ros as gc
from gravity_comp_ros.simulation.arms import gravity_torque, Payload, with_payload
import numpy as np

SECONDS = (12.0, 40.0)
# Mass of the body as a share of that of the moving links; distance of its centre in m.
_MASS, _DISTANCE = (0.02, 0.2), 0.1


def errors_of(name: str, seed: int) -> Result:
    """Return the mass in kg and the errors of a case in percent."""
    arm, rng = arm_of(urdf(name)), generator(name, seed, 2)
    setting = Setting.drawn(arm, rng)
    friction = setting.friction()
    moving = sum(body.mass for body in arm.model.inertias[1:])
    direction = rng.standard_normal(3)
    payload = Payload(float(np.exp(rng.uniform(*np.log(_MASS))) * moving), tuple(
        rng.uniform(0.0, _DISTANCE) * direction / np.linalg.norm(direction)))
    held = with_payload(arm, payload)
    *train, loaded = (setting.run(friction, arm=one) for one in (arm, arm, held))
    poses = trained(train, rng)
    truth = gravity_torque(held, poses)

    def error(model: gc.Model) -> float:
        joints = [model.joints.index(joint) for joint in arm.joints]
        return rms(model.predict(poses)[:, joints], truth, setting.largest)

    result: Result = {'kg': payload.mass}
    with described(urdf(name), seed) as path:
        for prefix, axes in (('', None), ('described ', path)):
            model = gc.fit(recording(arm.joints, train), urdf=axes)
            result[f'{prefix}not updated %'] = error(model)
            for seconds in SECONDS:
                first = loaded.t < loaded.t[0] + seconds
                part = Run(*(values[first] for values in (
                    loaded.t, loaded.q, loaded.qd, loaded.tau)))
                later = recording(arm.joints, [part])
                result[f'{prefix}{seconds:g} s %'] = error(gc.update(model, later, urdf=axes))
    return result


if __name__ == '__main__':
    sys.exit(run(__doc__, arms_and_seeds, each, errors_of, figures, extremes))
