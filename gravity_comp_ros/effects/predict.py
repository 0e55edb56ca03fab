"""
Torque prediction of a model with its effects.

    tau = g(q) + sum_e X_e(q, qd, qdd, g, t; setting_e) c_e

X_e are the columns of effect e, c_e its coefficients. Some columns depend on earlier samples
(acceleration, presliding), so predict all recorded samples and select some afterwards.
"""

from __future__ import annotations

from collections.abc import Iterable

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import all_effects, broken_plug_ins
from gravity_comp_ros.errors import Hint, ModelMismatchError
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import printable
import numpy as np


def predict_torque(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return the predicted torque (M, N) in N·m of the samples' motion.

    Joints are matched by name and returned in the model's order.

    :raises ModelMismatchError: if a joint of the model is not among the samples, or an effect of
        the model is not installed.
    """
    samples = samples.joints(model.joints)
    gravity = model.predict(samples.q)
    if not model.applied.effects:
        return gravity
    return gravity + effect_torque(model, samples, gravity)


def effect_torque(model: GravityModel, samples: JointSamples,
                  gravity: FloatArray | None = None) -> FloatArray:
    """
    Return the torque (M, N) in N·m of the model's effects, without gravity.

    :param gravity: the model's gravity torque (M, N) in N·m, if known.
    :raises ModelMismatchError: as `predict_torque`.
    """
    return torque_of(model, model.applied.effects, samples, gravity)


def fitted_torque(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return the torque (M, N) in N·m of the effects that were fitted and are not predicted.

    :raises ModelMismatchError: as `predict_torque`.
    """
    return torque_of(model, model.fitted.effects, samples)


def torque_of(model: GravityModel, effects: Iterable[AppliedEffect], samples: JointSamples,
              gravity: FloatArray | None = None) -> FloatArray:
    """Return the torque (M, N) in N·m of some effects of a model, without gravity."""
    samples, effects = samples.joints(model.joints), tuple(effects)
    if not effects or not samples.n_samples:
        return np.zeros_like(samples.q)
    motion, total = motion_of(model, samples, gravity), np.zeros_like(samples.q)
    for applied in effects:
        torque, joints = torque_on(model, applied, motion)
        total[:, joints] += torque
    return total


def torque_on(model: GravityModel, applied: AppliedEffect, motion: Motion
              ) -> tuple[FloatArray, slice | int]:
    """
    Return the torque in N·m of one effect of a model, and the joints on which it acts.

    It is (M, N) on all joints, or (M,) on one.

    :raises ModelMismatchError: if the effect is not installed, or has other coefficients.
    """
    effect, joint = installed(applied), joint_number(model, applied)
    torque = effect.torque(motion, joint, applied.setting,
                           coefficients(applied, effect, motion, joint))
    return torque, slice(None) if effect.scope == 'arm' else joint


def motion_of(model: GravityModel, samples: JointSamples,
              gravity: FloatArray | None = None) -> Motion:
    """Return the motion from which the columns of a model's effects are computed."""
    torque = model.predict(samples.q) if gravity is None else gravity
    return Motion.of(samples, torque, lambda q: gravity_gradient(model, q), model.chain,
                     model.geometry)


def installed(applied: AppliedEffect) -> Effect:
    """
    Return the effect of the library or a plug-in with the name of an applied one.

    :raises ModelMismatchError: if it is not installed.
    """
    effect = all_effects().get(applied.name)
    if effect is None:
        broken = broken_plug_ins()
        why = f' ({broken[0]})' if broken else ''
        raise ModelMismatchError(
            f'the model has an effect {printable(applied.name)} that is not installed here{why}',
            Hint.INSTALL_EFFECT)
    return effect


def joint_number(model: GravityModel, applied: AppliedEffect) -> int:
    """Return the joint number for an effect's methods: 0 for the whole arm."""
    return 0 if applied.joint is None else model.joints.index(applied.joint)


def coefficients(applied: AppliedEffect, effect: Effect, motion: Motion,
                 joint: int) -> FloatArray:
    """
    Return the coefficients (K,) of an applied effect in the order of its columns.

    :raises ModelMismatchError: if the installed effect has others.
    """
    symbols = [c.symbol for c in effect.coefficients_of(motion, joint, applied.setting)]
    if set(symbols) != set(applied.coefficients):
        raise ModelMismatchError(
            f'the model has {applied.target} with the coefficients '
            f'{", ".join(applied.coefficients)}, but the installed version has '
            f'{", ".join(symbols)}. Remove the effect and add it again')
    return np.array([applied.coefficients[symbol].value for symbol in symbols])
