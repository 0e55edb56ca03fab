"""Two links with friction and an offset, with torque by a formula."""

from gravity_comp_ros.data.samples import JointSamples
import numpy as np

NOISE, COULOMB, VISCOUS, OFFSET = 0.05, 0.6, 5.0, 0.4
JOINTS = ('shoulder', 'elbow')


def two_links(seed=0, count=1200, names=JOINTS, one_way=False, rough=1.0, reach=1.1):
    """
    Return 60 s of two links in an upright plane with friction; q = 0 hangs down.

    tau_1 = 10 s1 + 4 s12 + 0.6 tanh(qd_1 / 0.005) + 5 qd_1, tau_2 = 4 s12 + 0.4.

    With a `reach` of the elbow of 0.6 rad its offset and a weak joint spring are almost equally
    probable, and a fit takes twice as long.
    """
    t = 0.05 * np.arange(count)
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 6.0, 4)
    if one_way:
        q = np.column_stack([-1.0 + 0.03 * t, 1.2 * np.sin(0.09 * t)])
        qd = np.column_stack([np.full(count, 0.03), 0.108 * np.cos(0.09 * t)])
    else:
        q = np.column_stack([
            0.5 * np.sin(0.11 * t + phase[0]) + 0.1 * np.sin(0.7 * t + phase[1]),
            reach * np.sin(0.09 * t + phase[2]) + 0.1 * np.sin(0.5 * t + phase[3])])
        qd = np.column_stack([
            0.055 * np.cos(0.11 * t + phase[0]) + 0.07 * np.cos(0.7 * t + phase[1]),
            0.09 * reach * np.cos(0.09 * t + phase[2]) + 0.05 * np.cos(0.5 * t + phase[3])])
    both = 4.0 * np.sin(q.sum(axis=1))
    tau = np.column_stack([
        10.0 * np.sin(q[:, 0]) + both
        + rough * (COULOMB * np.tanh(qd[:, 0] / 0.005) + VISCOUS * qd[:, 0]),
        both + rough * OFFSET])
    return JointSamples.single_run(names, t, q, qd, tau + rng.normal(scale=NOISE, size=q.shape))


def two_link_urdf(names=JOINTS, masses=()):
    """
    Return a description of two links in an upright plane, 0.4 m each, hanging at q = 0.

    `masses` in kg are at the ends of the links; 1.53 and 1.02 give the torque of `two_links`.
    """
    joints = ''.join(
        f'<joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 {0.8 if k == 0 else -0.4}"/><axis xyz="0 1 0"/>'
        f'<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k, name in enumerate(names))
    bodies = ['', *(f'<inertial><origin xyz="0 0 -0.4"/><mass value="{mass}"/><inertia ixx="0.01" '
                    'ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
                    for mass in masses), *[''] * (len(names) - len(masses))]
    links = ''.join(f'<link name="l{k}">{body}</link>' for k, body in enumerate(bodies))
    return f'<robot name="two">{links}{joints}</robot>'
