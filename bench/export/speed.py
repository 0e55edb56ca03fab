"""
Time of a call of an exported model, and of Pinocchio's generalised gravity, in one C++ program.

    python3 -m bench.export.speed

needs g++, and for Pinocchio its headers: `pip install cmeel-eigen`, which the wheel does not
bring. Both run over the same poses of the same arm (bags/iiwa7.urdf), alternating, in one process.
"""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import sysconfig
import tempfile

from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.export.c_source import c_source
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
BAG, URDF = ROOT / 'bags' / 'eq17_unloaded.mcap', ROOT / 'bags' / 'iiwa7.urdf'
PREFIX = Path(sysconfig.get_paths()['purelib']) / 'cmeel.prefix'
KINDS = ('chain', 'potential', 'per_joint')

PROGRAM = r"""
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>
#include <vector>
#ifdef WITH_PINOCCHIO
#include <pinocchio/algorithm/rnea.hpp>
#include <fstream>
#endif
#include "chain_gravity.h"
#include "potential_gravity.h"
#include "per_joint_gravity.h"

const int N = CHAIN_N, POSES = 2000, ROUNDS = 201;

template <class F> double nanoseconds(F call) {
  auto start = std::chrono::steady_clock::now();
  for (int k = 0; k < POSES; ++k) call(k);
  auto end = std::chrono::steady_clock::now();
  return std::chrono::duration<double, std::nano>(end - start).count() / POSES;
}

int main(int, char **argv) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  std::vector<double> q(POSES * N);
  for (double &x : q) x = angle(random);
  std::vector<std::vector<double>> times(4);
  double tau[N], sum = 0.0;
#ifdef WITH_PINOCCHIO
  pinocchio::Model model;
  std::ifstream numbers(argv[1]);
  for (int k = 0; k < N; ++k) {
    Eigen::Matrix3d rotation, inertia;
    Eigen::Vector3d origin, centre;
    double mass;
    for (int i = 0; i < 9; ++i) numbers >> rotation(i / 3, i % 3);
    for (int i = 0; i < 3; ++i) numbers >> origin[i];
    numbers >> mass;
    for (int i = 0; i < 3; ++i) numbers >> centre[i];
    for (int i = 0; i < 9; ++i) numbers >> inertia(i / 3, i % 3);
    auto joint = model.addJoint(k, pinocchio::JointModelRZ(), pinocchio::SE3(rotation, origin),
                                "joint" + std::to_string(k));
    model.appendBodyToJoint(joint, pinocchio::Inertia(mass, centre, inertia));
  }
  pinocchio::Data data(model);
  std::vector<Eigen::VectorXd> poses;
  for (int k = 0; k < POSES; ++k)
    poses.push_back(Eigen::Map<Eigen::VectorXd>(&q[k * N], N));
#else
  (void)argv;
#endif
  for (int round = 0; round < ROUNDS; ++round) {
    times[0].push_back(nanoseconds([&](int k) { chain_gravity(&q[k * N], tau); sum += tau[1]; }));
    times[1].push_back(
        nanoseconds([&](int k) { potential_gravity(&q[k * N], tau); sum += tau[1]; }));
    times[2].push_back(
        nanoseconds([&](int k) { per_joint_gravity(&q[k * N], tau); sum += tau[1]; }));
#ifdef WITH_PINOCCHIO
    times[3].push_back(nanoseconds([&](int k) {
      sum += pinocchio::computeGeneralizedGravity(model, data, poses[k])[1]; }));
#endif
  }
  const char *names[] = {"chain", "potential", "per_joint", "Pinocchio"};
  for (int i = 0; i < 4; ++i) {
    if (times[i].empty()) continue;
    std::sort(times[i].begin(), times[i].end());
    std::printf("%-12s %8.0f %8.0f\n", names[i], times[i][ROUNDS / 2],
                times[i][ROUNDS * 99 / 100]);
  }
  return sum == 0.12345;
}
"""


def models() -> dict[str, GravityModel]:
    """Return the arm's model in every formulation."""
    samples = slow_samples(read_bag(BAG).samples).samples
    return {kind: fit(samples, FitOptions(formulation=kind)).model for kind in KINDS}


def write_arm(path: Path) -> None:
    """Write placement and inertia of every joint of the arm, which the program builds."""
    import pinocchio as pin
    model = pin.buildModelFromUrdf(str(URDF))
    assert {joint.shortname() for joint in list(model.joints)[1:]} == {'JointModelRZ'}
    rows = [np.concatenate([place.rotation.ravel(), place.translation, [body.mass], body.lever,
                            body.inertia.ravel()])
            for place, body in list(zip(model.jointPlacements, model.inertias))[1:]]
    np.savetxt(path, rows)


def compiled(folder: Path) -> Path:
    """Return the program; with Pinocchio if its headers and Eigen are installed."""
    sources = []
    for kind, model in models().items():
        code = c_source(model, kind)
        (folder / code.header_name).write_text(code.header)
        (folder / code.source_name).write_text(code.source)
        subprocess.run(['gcc', '-std=c99', '-O2', '-c', code.source_name], cwd=folder, check=True)
        sources.append(Path(code.source_name).with_suffix('.o').name)
        print(f'{kind}: {len(model.n_features())} joints, {model.n_features().sum()} terms of '
              f'torque')
    (folder / 'speed.cpp').write_text(PROGRAM)
    include = PREFIX / 'include'
    flags = []
    if (include / 'pinocchio').is_dir() and (include / 'eigen3').is_dir():
        flags = ['-DWITH_PINOCCHIO', '-DBOOST_MPL_LIMIT_LIST_SIZE=30', '-DNDEBUG',
                 '-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS',
                 *(f'-I{include / part}' for part in ('', 'eigen3')),
                 f'-L{PREFIX / "lib"}', f'-Wl,-rpath,{PREFIX / "lib"}', '-lpinocchio_default']
        write_arm(folder / 'arm.txt')
    else:
        print('no headers of Pinocchio and Eigen here: pip install pin cmeel-eigen')
    subprocess.run(['g++', '-std=c++17', '-O3', '-w', 'speed.cpp', *sources, '-o', 'speed',
                    *flags, '-lm'], cwd=folder, check=True)
    return folder / 'speed'


def main() -> int:
    """Compile, run and print the table."""
    with tempfile.TemporaryDirectory() as folder:
        program = compiled(Path(folder))
        print('time of a call, ns    median of 201 rounds of 2000 poses, 99 % of the rounds')
        sys.stdout.flush()
        return subprocess.run([program, f'{folder}/arm.txt'], check=False).returncode


if __name__ == '__main__':
    sys.exit(main())
