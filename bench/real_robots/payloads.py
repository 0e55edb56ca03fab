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

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
import sys
import tempfile

from bench.real_robots.arms import arm_of, urdf, with_other_masses
from bench.real_robots.cases import generator, Run, Setting, trained
from bench.real_robots.run import arms_and_seeds, each, rms
from bench.shared.runner import extremes, figures, Result, run
import gravity_comp_ros as gc
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, gravity_torque, Payload, with_payload
import numpy as np

SECONDS = (12.0, 40.0)
# Mass of the body as a share of that of the moving links; distance of its centre in m.
_MASS, _DISTANCE = (0.02, 0.2), 0.1


@dataclass(frozen=True, eq=False)
class Case:
    """
    Two runs of an arm, one with a payload, and poses (K, N) in rad of the trained box.

    `truth` (K, N) is the gravity torque with the payload, `largest` that of the arm, N·m.
    """

    arm: Arm
    train: tuple[Run, ...]
    loaded: Run
    payload: Payload
    poses: FloatArray
    truth: FloatArray
    largest: float

    @staticmethod
    def drawn(name: str, seed: int) -> Case:
        """Return the case of an arm and a seed."""
        arm, rng = arm_of(urdf(name)), generator(name, seed, 2)
        setting = Setting.drawn(arm, rng)
        friction = setting.friction()
        moving = sum(body.mass for body in arm.model.inertias[1:])
        direction = rng.standard_normal(3)
        payload = Payload(float(np.exp(rng.uniform(*np.log(_MASS))) * moving), tuple(
            rng.uniform(0.0, _DISTANCE) * direction / np.linalg.norm(direction)))
        held = with_payload(arm, payload)
        *train, loaded = (setting.run(friction, arm=each) for each in (arm, arm, held))
        poses = trained(train, rng)
        return Case(arm, tuple(train), loaded, payload, poses, gravity_torque(held, poses),
                    setting.largest)

    def recording(self, runs: Sequence[Run], seconds: float = np.inf) -> gc.Recording:
        """Return the first part of runs as a recording."""
        parts = [run.t < run.t[0] + seconds for run in runs]
        q, tau, t, qd = ([getattr(run, key)[part] for run, part in zip(runs, parts)]
                         for key in ('q', 'tau', 't', 'qd'))
        return gc.Recording.from_arrays(q, tau, t, qd=qd, names=self.arm.joints)

    def error(self, model: gc.Model) -> float:
        """Return the error of a model in percent."""
        joints = [model.joints.index(name) for name in self.arm.joints]
        return rms(model.predict(self.poses)[:, joints], self.truth, self.largest)


def errors_of(name: str, seed: int) -> Result:
    """Return the mass in kg and the errors of a case in percent."""
    case = Case.drawn(name, seed)
    out, train = {'kg': case.payload.mass}, case.recording(case.train)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.urdf'
        path.write_text(with_other_masses(urdf(name), seed), encoding='utf-8')
        for prefix, axes in (('', None), ('described ', path)):
            model = gc.fit(train, urdf=axes)
            out[f'{prefix}not updated %'] = case.error(model)
            for seconds in SECONDS:
                later = case.recording([case.loaded], seconds)
                out[f'{prefix}{seconds:g} s %'] = case.error(gc.update(model, later, urdf=axes))
    return out


if __name__ == '__main__':
    sys.exit(run(__doc__, arms_and_seeds, each, errors_of, figures, extremes))
