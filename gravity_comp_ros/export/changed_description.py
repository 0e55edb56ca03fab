"""A description whose masses, centres and friction are those of a model: the result."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from gravity_comp_ros.export.nearest_masses import Links, NearestMasses
from gravity_comp_ros.export.xml_edit import number, XmlEdit
from gravity_comp_ros.models.gravity_model import GravityModel


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
    the trained range. `effects` are written as friction; `left_out` are the others.
    """

    data: bytes
    links: Mapping[str, LinkChange]
    before: Mapping[str, float]
    after: Mapping[str, float]
    effects: tuple[str, ...]
    left_out: Mapping[str, str]
    notes: tuple[str, ...]


def changed_description(edit: XmlEdit, model: GravityModel, links: Links, result: NearestMasses,
                        effects: tuple[str, ...], reason: str, notes: Sequence[str],
                        joints: Sequence[str] = ()) -> ChangedDescription:
    """
    Return the result of an edit.

    :param reason: why the other effects of the model are left out.
    :param joints: in the order of the result (default: that of the model).
    """
    names = tuple(joints) or model.joints
    changes = {name: LinkChange(float(mass_before), float(mass), tuple(before.tolist()),
                                tuple(centre.tolist()))
               for name, mass_before, before, mass, centre in zip(
                   links.names, links.masses, links.centres, result.masses, result.centres)}
    left_out = {effect.target: reason for effect in model.applied.effects
                if effect.target not in effects}
    return ChangedDescription(edit.result(), changes, dict(zip(names, result.before.tolist())),
                              dict(zip(names, result.after.tolist())), effects, left_out,
                              tuple(notes))


def written_friction(model: GravityModel) -> tuple[str, ...]:
    """Return the targets of the effects of a model that a description has as friction."""
    return friction_numbers(model, model.joints, 'coulomb', 'viscous')[1]


def friction_numbers(model: GravityModel, joints: Collection[str], coulomb: str, viscous: str
                     ) -> tuple[dict[str, dict[str, str]], tuple[str, ...]]:
    """
    Return the attributes for Coulomb and viscous friction by joint, and the targets written.

    :param coulomb: name of the attribute in N·m. :param viscous: of that in N·m·s/rad.
    """
    keys = {'coulomb_friction': ('F_c', coulomb), 'viscous_friction': ('F_v', viscous)}
    values: dict[str, dict[str, str]] = {}
    written = []
    for effect in model.applied.effects:
        symbol, key = keys.get(effect.name, ('', ''))
        if effect.joint is not None and effect.joint in joints and symbol in effect.coefficients:
            values.setdefault(effect.joint, {})[key] = number(effect.coefficients[symbol].value)
            written.append(effect.target)
    return values, tuple(written)
