"""
An MJCF (MuJoCo XML) with masses and centres of mass that give the gravity torque of a model.

MuJoCo itself reads the file, since defaults, angles, frames and masses from shapes determine its
numbers. It also gives the torque per mass, with the gravity of the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.export.changed_description import (
    changed_description, ChangedDescription, Links)
from gravity_comp_ros.export.xml_edit import Element, number, XmlEdit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import printable, shown_names
import numpy as np


def changed_mjcf(path: Path, data: bytes, model: GravityModel) -> ChangedDescription:
    """
    Return an MJCF with the masses and centres nearest to its own that give the model's torque.

    :param path: of the file, in whose folder its meshes are. :param data: its bytes.
    :raises DataError: if MuJoCo does not load it, or it takes all masses from shapes.
    :raises ModelMismatchError: if it describes another arm, or bodies are in included files.
    """
    edit = _edit(data, str(path))
    arm = _Mujoco(path, model.joints)
    elements = _body_elements(edit, arm, str(path))

    def write(link: int, mass: float, centre: FloatArray) -> None:
        _write(edit, elements[arm.bodies[link]], arm, arm.bodies[link], mass, centre)

    joints = {element.attributes.get('name', ''): element for element in edit.root.descendants()
              if element.tag == 'joint'}
    return changed_description(edit, model, arm.links(), arm.columns, write, joints,
                               ('', 'frictionloss', 'damping'), 'an MJCF has no such effect')


def _edit(data: bytes, source: str) -> XmlEdit:
    try:
        root = fromstring(data.strip())
    except (DefusedXmlException, ValueError, SyntaxError, RecursionError) as problem:
        raise DataError(f'{source} is not an MJCF: {printable(str(problem))}') from problem
    if root.tag != 'mujoco':
        raise DataError(f'{source} is not an MJCF: its root is <{printable(root.tag)}>, not '
                        f'<mujoco>')
    for compiler in root.iter('compiler'):
        if compiler.get('inertiafromgeom') == 'true' or compiler.get('settotalmass'):
            raise DataError(f'{source}: its <compiler> replaces all masses (inertiafromgeom or '
                            f'settotalmass): remove that attribute')
    return XmlEdit(data, source)


class _Mujoco:
    """The arm in MuJoCo: `bodies` are the numbers of the bodies with mass that it carries."""

    def __init__(self, path: Path, joints: tuple[str, ...]) -> None:
        import mujoco
        self._mujoco: Any = mujoco
        try:
            self.model: Any = mujoco.MjModel.from_xml_path(str(path))
        except ValueError as problem:
            raise DataError(f'MuJoCo does not load {path}: {printable(str(problem))}'
                            ) from problem
        ids = [mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in joints]
        self.names = [self.model.joint(k).name for k in range(self.model.njnt)]
        missing = [name for name, k in zip(joints, ids) if k < 0]
        if missing:
            raise ModelMismatchError(f'{path} has no joint {", ".join(missing)}; it has '
                                     f'{shown_names([printable(x) for x in self.names])}')
        for name, k in zip(joints, ids):
            if self.model.jnt_type[k] != mujoco.mjtJoint.mjJNT_HINGE:
                raise ModelMismatchError(f'{path}: joint {name} is no hinge')
        self._qpos, self._dofs = self.model.jnt_qposadr[ids], self.model.jnt_dofadr[ids]
        of_joints = set(self.model.jnt_bodyid[ids].tolist())
        carried: set[int] = set()
        for body in range(1, self.model.nbody):  # parents have smaller numbers
            if body in of_joints or int(self.model.body_parentid[body]) in carried:
                carried.add(body)
        self.bodies = [body for body in sorted(carried) if self.model.body_mass[body] > 0.0]
        if not self.bodies:
            raise DataError(f'{path} gives no mass to any body of the arm')

    def links(self) -> Links:
        """Return masses, centres and second moments of the bodies."""
        model, moments = self.model, []
        for body in self.bodies:
            rotation = np.empty(9)
            self._mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
            axes, inertia = rotation.reshape(3, 3), model.body_inertia[body]
            moments.append(axes @ np.diag(0.5 * inertia.sum() - inertia) @ axes.T)
        names = tuple(printable(model.body(body).name) or f'body {body}' for body in self.bodies)
        return Links(names, model.body_mass[self.bodies].copy(),
                     model.body_ipos[self.bodies].copy(), np.array(moments))

    def columns(self, q: FloatArray) -> FloatArray:
        """Return the torque (M, N, 4L) per mass and first moment at q (M, N) in rad."""
        mj, model = self._mujoco, self.model
        data, result = mj.MjData(model), np.empty((*q.shape, len(self.bodies), 4))
        at = np.empty((3, model.nv))
        for row, pose in zip(result, q):
            data.qpos[self._qpos] = pose
            mj.mj_kinematics(model, data)
            mj.mj_comPos(model, data)
            for number_, body in enumerate(self.bodies):
                points = data.xpos[body] + np.vstack([np.zeros(3),
                                                      data.xmat[body].reshape(3, 3).T])
                for k, point in enumerate(points):
                    mj.mj_jac(model, data, at, None, point, body)
                    row[:, number_, k] = -(model.opt.gravity @ at)[self._dofs]
                row[:, number_, 1:] -= row[:, number_, :1]
        return result.reshape(*q.shape, -1)


def _body_elements(edit: XmlEdit, arm: _Mujoco, source: str) -> dict[int, Element]:
    """Return the element of each body, by number; MuJoCo numbers them in the file's order."""
    elements = [element for part in edit.root.children if part.tag == 'worldbody'
                for element in part.descendants() if element.tag == 'body']
    names = [arm.model.body(k).name for k in range(1, arm.model.nbody)]
    if [element.attributes.get('name', '') for element in elements] != names:
        raise ModelMismatchError(f'{source} includes, repeats or attaches bodies of other parts: '
                                 f'export into the file that has all bodies of the arm itself')
    return dict(enumerate(elements, start=1))


def _write(edit: XmlEdit, element: Element, arm: _Mujoco, body: int, mass: float,
           centre: FloatArray) -> None:
    inertial, pos = element.child('inertial'), ' '.join(map(number, centre.tolist()))
    if inertial is not None:
        edit.set(inertial, 'mass', number(mass))
        edit.set(inertial, 'pos', pos)
        return
    quat, diagonal = (' '.join(map(number, values.tolist())) for values in (
        arm.model.body_iquat[body], arm.model.body_inertia[body]))
    edit.insert(element, f'<inertial pos="{pos}" quat="{quat}" mass="{number(mass)}" '
                         f'diaginertia="{diagonal}"/>')
