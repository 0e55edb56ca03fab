"""
A description with the masses and centres nearest to its own that give a model's gravity torque.

The gravity torque is linear in the mass m and the first moment h = m c of every link, tau = Y(q) x
with x = (m, h) of all links, and slow motion determines fewer numbers than that. The others stay
as near as possible to the description: the sum over links of

    m / m0 - ln(m / m0) - 1 + m (c - c0)' S0^-1 (c - c0)

is minimal, with S0 the second moment of the link's mass about its centre. It is the entropic
(Bregman) divergence of the pseudo-inertia matrices, minimal over the second moments as well: the
minimum leaves those about the centre of mass unchanged. It is convex, it is infinite at m = 0, and
it is independent of the frames (T. Lee, P. M. Wensing, F. C. Park, Geometric robot dynamic
identification: a convex programming approach, IEEE Trans. Robotics 36, 2020). So masses are
positive, and with the inertia of the description about the new centre the links are physically
consistent.

The torque is that of the model within its covariance. Where the motion did not separate gravity
from another static torque, such as a spring, the masses of the description decide.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.predict import EffectInUse, motion_of, static_effects
from gravity_comp_ros.errors import FitError, ModelMismatchError
from gravity_comp_ros.export.xml_edit import Element, number, XmlEdit
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import shown_names
import numpy as np

# Coefficients of the effects that a description has as friction.
_SYMBOLS = {'coulomb_friction': 'F_c', 'viscous_friction': 'F_v'}


@dataclass(frozen=True)
class NearestOptions:
    """
    Options of the search.

    `poses` are drawn from the trained range. `tolerance` is the standard deviation, in addition to
    that of the model, with which the torque of the masses follows the model's, as a share of the
    joint's largest: no torque sensor is that accurate. `min_radius` in m is the smallest radius of
    gyration of a link, since many descriptions give point masses. `max_misfit` is the largest RMS
    deviation from the model, as a share of the joint's RMS torque, beyond the noise: a larger one
    is that of another arm. `mass_error` is the relative standard deviation of the masses of a
    description, with which they decide where gravity is uncertain by `errors` standard deviations
    of the model. `thinnest` is the smallest second moment along an axis of a repaired inertia, as
    a share of the largest. `converged` is the gradient by the logarithms of the masses at which
    the search ends; at more than `acceptable` it failed.

    :raises OptionError: if a number is not positive.
    """

    poses: int = 400
    tolerance: float = 5e-4
    min_radius: float = 0.01
    max_misfit: float = 0.05
    mass_error: float = 0.3
    errors: float = 3.0
    thinnest: float = 1e-3
    converged: float = 1e-8
    acceptable: float = 1e-3

    def __post_init__(self) -> None:
        check_positive(self, 'nearest masses')


@dataclass(frozen=True, eq=False)
class Links:
    """
    The links of a description that carry mass.

    `masses` (L,) in kg, `centres` (L, 3) in m and `second_moments` (L, 3, 3) in kg m^2 about the
    centres, all in the frames of the links.
    """

    names: tuple[str, ...]
    masses: FloatArray
    centres: FloatArray
    second_moments: FloatArray

    @property
    def parameters(self) -> FloatArray:
        """Return x (4L,): mass and first moment of every link."""
        return np.column_stack([self.masses, self.masses[:, None] * self.centres]).ravel()


def nearest_masses(links: Links, regressor: FloatArray, torque: FloatArray, noise: FloatArray,
                   joints: tuple[str, ...], deviations: FloatArray,
                   options: NearestOptions = NearestOptions()) -> FloatArray:
    """
    Return the masses and first moments x (4L,) that give a torque, as `Links.parameters`.

    :param regressor: Y (M, N, 4L) at M poses, columns as `Links.parameters`.
    :param torque: of the model (M, N) in N·m at these poses.
    :param noise: of the model (N,) in N·m; a deviation of that size is no misfit.
    :param deviations: of the torque (K, M, N) by independent errors of the model.
    :raises ModelMismatchError: if no masses give this torque.
    """
    m, n = torque.shape
    scale = options.tolerance * np.maximum(np.abs(torque).max(axis=0),
                                           0.1 * np.abs(torque).max(initial=1e-6))
    rows, target = (regressor / scale[:, None]).reshape(m * n, -1), (torque / scale).ravel()
    # The covariance of the target is the identity plus that of the errors.
    axes, size, _ = np.linalg.svd((options.errors * deviations / scale).reshape(-1, m * n).T,
                                  full_matrices=False)
    share = 1.0 / np.sqrt(1.0 + size ** 2)

    def weighted(values: FloatArray, factor: FloatArray) -> FloatArray:
        return np.asarray(values + axes @ ((factor - 1.0) * (axes.T @ values).T).T)

    x = _minimum(links, options.mass_error * weighted(rows, share),
                 options.mass_error * weighted(target, share), options)
    # Without the most probable errors of the model.
    residual = weighted(rows @ x - target, share ** 2).reshape(m, n) * scale
    _check_misfit(residual, _limit(torque, noise, options), joints)
    return x


def _minimum(links: Links, rows: FloatArray, target: FloatArray,
             options: NearestOptions) -> FloatArray:
    """
    Return x of the least divergence plus half the squared deviation.

    For given masses the best first moments are linear in the target. What remains is a function
    of the logarithms of the masses, whose gradient is that at fixed moments (envelope theorem).
    """
    from scipy.linalg import block_diag  # imported here because they take 0.4 s
    from scipy.optimize import minimize
    count, size = len(links.masses), np.arange(3)
    second = links.second_moments.copy()
    second[:, size, size] += links.masses[:, None] * options.min_radius ** 2
    weight, columns = np.linalg.inv(second), rows.reshape(len(rows), count, 4)
    moments = columns[:, :, 1:].reshape(len(rows), -1)
    masses = columns[:, :, 0] + np.einsum('rli,li->rl', columns[:, :, 1:], links.centres)
    gram = moments.T @ moments

    def best(logs: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Return cost, gradient and x for logarithms (L,) of the masses over those before."""
        m = links.masses * np.exp(logs)
        rest = target - masses @ m
        shift = np.linalg.solve(gram + block_diag(*(2.0 * weight / m[:, None, None])),
                                moments.T @ rest)
        rest, h = rest - moments @ shift, shift.reshape(count, 3)
        spread = np.einsum('li,lij,lj->l', h, weight, h) / m
        ratio = np.exp(logs)
        cost = (ratio - logs - 1.0 + spread).sum() + 0.5 * rest @ rest
        return float(cost), ratio - 1.0 - spread - m * (masses.T @ rest), np.column_stack(
            [m, m[:, None] * links.centres + h]).ravel()

    result = minimize(lambda logs: best(logs)[:2], np.zeros(count), jac=True,
                      options={'gtol': options.converged})
    if np.abs(result.jac).max() > options.acceptable:
        raise FitError('the masses nearest to the description did not converge')
    return best(result.x)[2]


def _limit(torque: FloatArray, noise: FloatArray, options: NearestOptions) -> FloatArray:
    """Return the largest RMS (N,) in N·m that is no misfit."""
    return np.asarray(options.max_misfit * np.sqrt((torque ** 2).mean(axis=0)) + noise)


def _check_misfit(residual: FloatArray, limit: FloatArray, joints: tuple[str, ...]) -> None:
    rms = np.sqrt((residual ** 2).mean(axis=0))
    wrong = [joint for joint, is_wrong in zip(joints, rms > limit) if is_wrong]
    if wrong:
        worst = int(np.argmax(rms - limit))
        raise ModelMismatchError(
            f'no masses on the axes of the description give the torque of the model on '
            f'{shown_names(wrong)}: it differs by {rms[worst]:.2g} N·m on {joints[worst]}. '
            f'`gravity_comp check --urdf` names what differs: axis, zero angle, mount; a '
            f'per_joint model may be of no arm: fit a chain')


@dataclass(frozen=True)
class LinkChange:
    """Mass in kg and centre of mass in m of a link, in the description and in the result."""

    mass_before: float
    mass: float
    centre_before: tuple[float, ...]
    centre: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class ChangedDescription:
    """
    The changed file, its links by name, and what could not be written.

    `before` and `after` are, by joint, the largest deviation in N·m from the model's torque in
    the trained range. `effects` are written as friction; `left_out` are the others. `uncertain`
    are joints whose gravity torque the model does not determine, so that the description decides.
    """

    data: bytes
    links: Mapping[str, LinkChange]
    before: Mapping[str, float]
    after: Mapping[str, float]
    effects: tuple[str, ...]
    left_out: Mapping[str, str]
    notes: tuple[str, ...]
    uncertain: tuple[str, ...]


def changed_description(edit: XmlEdit, model: GravityModel, links: Links,
                        columns: Callable[[FloatArray], FloatArray],
                        write: Callable[[int, float, FloatArray], None],
                        joints: Mapping[str, Element], friction: tuple[str, str, str],
                        reason: str, notes: Sequence[str] = ()) -> ChangedDescription:
    """
    Return an edit with the masses, centres and friction of a model.

    :param columns: torque (M, N, 4L) per mass and first moment of the links at q (M, N) in rad.
    :param write: writes mass in kg and centre (3,) in m of a link, by its number.
    :param joints: elements of the joints by name.
    :param friction: child of a joint with friction ('' for the joint itself), and its attributes
        of Coulomb friction in N·m and viscous friction in N·m·s/rad.
    :param reason: why the other effects of the model are left out.
    :raises ModelMismatchError: if no masses give the torque of the model.
    """
    q = random_poses(model.n_joints, model.coverage.q_min, model.coverage.q_max,
                     NearestOptions.poses)
    regressor, torque, changes = columns(q), model.predict(q), {}
    x = nearest_masses(links, regressor, torque, model.noise, model.joints, _deviations(model, q))
    for k, (name, (mass, *moment)) in enumerate(zip(links.names, x.reshape(-1, 4).tolist())):
        centre = np.array(moment) / mass
        write(k, mass, centre)
        changes[name] = LinkChange(float(links.masses[k]), mass,
                                   tuple(links.centres[k].tolist()), tuple(centre.tolist()))
    before, after = (
        dict(zip(model.joints, np.abs(regressor @ each - torque).max(axis=0).tolist()))
        for each in (links.parameters, x))
    rms = np.sqrt(((regressor @ x - torque) ** 2).mean(axis=0))
    # An interval that contains 0: gravity absorbs the effect.
    absorbed = {effect.joint for effect in static_effects(model.applied.effects) if all(
        x.ci95[0] <= 0.0 <= x.ci95[1] for x in effect.coefficients.values())}
    limits = _limit(torque, model.noise, NearestOptions())
    uncertain = tuple(joint for joint, error, limit in zip(model.joints, rms, limits)
                      if error > limit or joint in absorbed)
    written = written_friction(model, joints)
    _write_friction(edit, joints, written, friction)
    left_out = {effect.target: reason for effect in model.applied.effects
                if effect not in written}
    return ChangedDescription(edit.result(), changes, before, after,
                              tuple(effect.target for effect in written), left_out, tuple(notes),
                              uncertain)


def _deviations(model: GravityModel, q: FloatArray) -> FloatArray:
    """
    Return changes (K, M, N) in N·m of the gravity torque by independent errors of the model.

    The motion determines the sum of gravity and static effects: errors of these are errors of it.
    """
    motion = motion_of(model, JointSamples.at_rest(model.joints, q))
    parts = [np.zeros((0, *q.shape)) if model.covariance is None else model.deviations(q)]
    for applied in static_effects(model.applied.effects):
        effect = EffectInUse.of(model, applied, motion)
        std = np.array([applied.coefficients[name].half / HALF_95 for name in effect.symbols])
        parts.append(std[:, None, None] * effect.columns(motion))
    return np.concatenate(parts)


def written_friction(model: GravityModel, joints: Collection[str]) -> list[AppliedEffect]:
    """Return the effects of a model on some joints that a description has as friction."""
    return [effect for effect in model.applied.effects if effect.joint in joints
            and _SYMBOLS.get(effect.name, '') in effect.coefficients]


def _write_friction(edit: XmlEdit, joints: Mapping[str, Element],
                    effects: Iterable[AppliedEffect], friction: tuple[str, str, str]) -> None:
    tag, keys = friction[0], dict(zip(_SYMBOLS, friction[1:]))
    values: dict[str, dict[str, str]] = {}
    for effect in effects:
        values.setdefault(str(effect.joint), {})[keys[effect.name]] = number(
            effect.coefficients[_SYMBOLS[effect.name]].value)
    for name, attributes in values.items():
        element = joints[name].child(tag) if tag else joints[name]
        if element is None:
            text = ' '.join(f'{key}="{value}"' for key, value in sorted(attributes.items()))
            edit.insert(joints[name], f'<{tag} {text}/>')
            continue
        for key, text in attributes.items():
            edit.set(element, key, text)
