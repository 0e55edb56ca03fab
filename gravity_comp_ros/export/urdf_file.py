"""A URDF with masses and centres of mass that give the gravity torque of a model."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.links import (
    described_arm, DescribedArm, INERTIA_KEYS, Inertial, Positions)
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.export.changed_description import (
    changed_description, ChangedDescription, Links, NearestOptions)
from gravity_comp_ros.export.xml_edit import Element, number, XmlEdit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import printable
import numpy as np


def changed_urdf(data: bytes, model: GravityModel, source: str = 'URDF',
                 fixed: Positions = MappingProxyType({})) -> ChangedDescription:
    """
    Return a URDF with the masses and centres nearest to its own that give the model's torque.

    Inertias about the centre of mass stay. Coulomb and viscous friction of the model are written
    as `<dynamics>`. Axes and zero angles are not changed.

    :raises DataError: if the file is not a URDF, or has no masses on the arm.
    :raises ModelMismatchError: if it describes another arm.
    """
    arm = described_arm(data, model.joints, source, fixed)
    edit = XmlEdit(data, source)
    elements = _elements(edit, arm)
    inertials = {name: inertial for name, inertial in arm.inertials().items()
                 if inertial.mass > 0.0}
    links = Links(tuple(inertials), np.array([x.mass for x in inertials.values()]),
                  np.array([x.centre for x in inertials.values()]),
                  np.array([_consistent(x.second_moment) for x in inertials.values()]))
    order = [model.joints.index(name) for name in arm.geometry.joints]

    def columns(q: FloatArray) -> FloatArray:
        return arm.columns(q[:, order], links.names)[:, np.argsort(order)]

    def write(link: int, mass: float, centre: FloatArray) -> None:
        _write(edit, elements[links.names[link]], mass, centre)

    joints = {printable(joint.attributes.get('name', '')): joint for joint in edit.root.children
              if joint.tag == 'joint'}
    return changed_description(edit, model, links, columns, write, joints,
                               ('dynamics', 'friction', 'damping'),
                               'a URDF has no such effect', _repaired(edit, elements, inertials))


def _elements(edit: XmlEdit, arm: DescribedArm) -> dict[str, Element]:
    """Return the <inertial> of the links that the arm carries, by link."""
    links = {printable(link.attributes.get('name', '')): link.child('inertial')
             for link in edit.root.children if link.tag == 'link'}
    return {name: element for name, element in links.items()
            if element is not None and name in arm.places}


def _consistent(second_moment: FloatArray) -> FloatArray:
    """Return the nearest second moment that no mass distribution contradicts."""
    values, vectors = np.linalg.eigh(second_moment)
    if values[0] >= -1e-9 * abs(values[-1]):
        return second_moment
    smallest = NearestOptions().thinnest * values[-1]
    return np.asarray(vectors @ np.diag(np.maximum(values, smallest)) @ vectors.T)


def _repaired(edit: XmlEdit, elements: Mapping[str, Element],
              inertials: Mapping[str, Inertial]) -> list[str]:
    """Write the inertias that break the triangle inequality, and return a note for each."""
    notes = []
    for name, inertial in inertials.items():
        consistent = _consistent(inertial.second_moment)
        element = elements[name].child('inertia')
        if element is None or np.array_equal(consistent, inertial.second_moment):
            continue
        inertia = np.trace(consistent) * np.eye(3) - consistent
        own = inertial.rotation.T @ inertia @ inertial.rotation
        for key, (row, column) in zip(INERTIA_KEYS, zip(*np.triu_indices(3))):
            edit.set(element, key, number(float(own[row, column])))
        notes.append(f'link {name}: no body has the inertia of the description (the triangle '
                     f'inequality); it has the nearest possible one')
    return notes


def _write(edit: XmlEdit, inertial: Element, mass: float, centre: FloatArray) -> None:
    mass_element, origin = inertial.child('mass'), inertial.child('origin')
    if mass_element is None:
        raise ModelMismatchError('an <inertial> has no <mass>')
    edit.set(mass_element, 'value', number(mass))
    xyz = ' '.join(map(number, centre.tolist()))
    if origin is None:
        edit.insert(inertial, f'<origin xyz="{xyz}" rpy="0 0 0"/>')
    else:
        edit.set(origin, 'xyz', xyz)
