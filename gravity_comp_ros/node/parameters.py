"""
The one table of the node's parameters.

It makes the types, the descriptors, the checks on set, and docs/parameters.md:
`python3 docs/make_parameters.py > docs/parameters.md`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node.parameter import parameter, row_of

# A model takes at most so many.
MOST_JOINTS = 10


@dataclass(frozen=True)
class Parameters:
    """
    The parameters of the node, each of its type and in its range (`Parameter.parse`).

    :raises OptionError: if two of them contradict each other.
    """

    autostart: bool = parameter(
        True, 'Configure and activate without being told to. Set it to false where a lifecycle '
        'manager does that.', read_only=True)
    diagnostics_rate: float = parameter(
        1.0, 'How often /diagnostics is published.', 'Hz', 0.1, 20.0, read_only=True)
    joints: tuple[str, ...] = parameter(
        (), 'Joint names, in the order of the torques on `~/commands`. If the list is empty, the '
        'names of the model file are taken, and without one those of the first `joint_states` '
        'message: set it where grippers or several arms share the topic.', read_only=True)
    effort_scale: tuple[float, ...] = parameter(
        (), 'Torque per unit of the effort field, sign included: the torque constant where effort '
        'is a motor current, -1 where it counts the other way. One value for all joints or one '
        'per joint; empty means 1.', 'N·m per unit', -1e6, 1e6, read_only=True)
    robot_description: str = parameter(
        'auto', 'Where the axes of the arm, its joints without end and its effort limits are '
        'taken from: `auto` listens to the topic `robot_description`, `off` does not, anything '
        'else is the text of a URDF.', read_only=True, may_be_off=True)
    continuous_joints: tuple[str, ...] = parameter(
        (), 'Joints that may turn without end. Any other joint further than 4π from 0 is refused '
        'as a pose: angles in degrees are such. Torque has a period of one turn for every joint.',
        read_only=True)
    max_speed: float = parameter(
        0.15, 'Samples are learned from while no joint is faster than this.', 'rad/s', 0.001, 10.0)
    max_acceleration: float = parameter(
        0.0, 'Samples are learned from while no joint accelerates more than this, as a mean over '
        '0.1 s; 0 does not judge it.', 'rad/s²', 0.0, 1000.0)
    sample_rate: float = parameter(
        5.0, 'At most so many samples are taken per second.', 'Hz', 0.1, 1000.0)
    capacity: int = parameter(
        1500, 'Samples kept; once they are there, new poses replace those that have a close '
        'neighbour.', 'samples', 50, 20000, read_only=True)
    auto_fit: bool = parameter(
        True, 'In an open epoch, fit by itself as samples come. If false, only `~/refit` fits.')
    formulation: str = parameter(
        'auto', 'The model: one sparse energy for all joints (`potential`); the same with the '
        'structure of a serial arm (`chain`); whichever of the two predicts held-out samples '
        'better (`auto`); or a separate sum per joint as in the paper.',
        choices=('auto', 'potential', 'chain', 'per_joint'))
    effects: tuple[str, ...] = parameter(
        (), 'Effects that fits of a whole model tell apart from gravity, `NAME` or `NAME:JOINT`; '
        'call `~/refit` after a change. The feed-forward stays gravity alone, but for those in '
        '`compensate`.')
    compensate: tuple[str, ...] = parameter(
        (), 'Effects of the model, `NAME` or `NAME:JOINT`, whose torque is sent as well: '
        '`coulomb_friction`, `viscous_friction`, `stribeck_friction`, `degressive_friction`, '
        '`load_dependent_friction`, `torque_offset`, `joint_spring` or `cable_stiffness`. Those '
        'that the model does not have count for nothing, and diagnostics say so.')
    compensate_fraction: float = parameter(
        0.7, 'How much of it is sent. All of a friction makes an arm slide by itself.', '', 0.0,
        1.0)
    compensate_speed: float = parameter(
        0.02, 'Friction that is compensated turns its sign over this speed at least: above the '
        'noise of the velocity at rest.', 'rad/s', 0.001, 1.0)
    settle_time: float = parameter(
        0.5, 'For this long after `~/payload_changed` nothing is learned: messages from before '
        'the call are still under way, and the payload still swings.', 's', 0.0, 60.0)
    min_samples: int = parameter(
        30, 'With a model whose change can be fitted, the first fit of an epoch waits for so many '
        'samples to learn from.', 'samples', 10, 10000)
    first_samples: int = parameter(
        100, 'Without such a model it waits for so many: fewer fit well and predict badly. So it '
        'does once the effort was broken.', 'samples', 10, 10000)
    full_samples: int = parameter(
        500, 'The epoch closes with a fit of this many samples, once every joint has its range.',
        'samples', 20, 20000)
    min_span: float = parameter(
        0.2, 'A joint that moved over less than this in an epoch is reported as lacking range.',
        'rad', 0.0, 6.3)
    max_payload: float = parameter(
        20.0, 'The heaviest body that is put on the last link or taken off. A change of the '
        'torque that takes more is refused.', 'kg', 0.01, 1000.0)
    max_payload_reach: float = parameter(
        1.0, 'How far the centre of a payload may be from the last joint; without known axes also '
        'the longest distance of two neighbouring joints.', 'm', 0.01, 10.0)
    on_suspected_payload: str = parameter(
        'report', 'What to do where the residual shows a payload that the node was not told of: '
        '`report` publishes an event on `~/payload_suspected`, `learn` does that and then what '
        '`~/payload_changed` does.', choices=('report', 'learn'))
    suspect_after: float = parameter(
        16.0, 'How long a change of the torque must last before it is called a payload. A hand '
        'that presses straight down makes the torque of a weight for as long as it presses.', 's',
        0.0, 120.0, read_only=True)
    fit_timeout: float = parameter(
        120.0, 'A fit that takes longer is taken for hanging: its process is killed and replaced.',
        's', 0.1, 3600.0)
    refit_timeout: float = parameter(
        60.0, '`~/refit` answers after this time even if the fit still runs.', 's', 0.1, 3600.0)
    model_file: str = parameter(
        '', 'Loaded on configuring if it exists, written by `~/save_model`.', read_only=True)
    auto_save: bool = parameter(
        False, 'Write the model file whenever a new model is taken into use.')
    history: int = parameter(
        10, 'Earlier payloads whose last model `~/rollback` can bring back.', 'payloads', 1, 100,
        read_only=True)
    enabled: bool = parameter(
        True, 'Publish torques from the start; `~/enable` changes it while the node runs.',
        read_only=True)
    ramp_time: float = parameter(
        1.0, 'Time over which torque goes from none to that of the model, or from the old model '
        'to the new one; a change of the model by more than 12 N·m takes longer in proportion. 0 '
        'does either at once.', 's', 0.0, 60.0)
    max_torque: tuple[float, ...] = parameter(
        (), 'Largest torque that is published: one value for all joints or one per joint. If it '
        'is empty, the effort limits of the robot description count; without those nothing is '
        'published, unless `unlimited_torque` is set.', 'N·m', 0.0, 100000.0)
    unlimited_torque: bool = parameter(
        False, 'Publish torque although no bound is known.')
    max_torque_rate: tuple[float, ...] = parameter(
        (500.0,), 'Fastest change of a published torque: one value for all joints or one per '
        'joint. Empty sets no bound.', 'N·m/s', 0.001, 1e6)
    extrapolation: str = parameter(
        'hold', 'What to do with poses further than `extrapolation_margin` outside the trained '
        'range: `hold` computes the torque of the nearest pose inside the margin, `fade` lets '
        'torque fall to zero over a second margin, `trust` uses the model as it is.',
        choices=('hold', 'fade', 'trust'))
    extrapolation_margin: float = parameter(
        1.0, 'Distance outside the trained range up to which the model is used as it is; at most '
        '0.1 rad for a `per_joint` model, which is wrong by far out there.', 'rad', 0.01, 10.0)
    stale_after: float = parameter(
        0.3, 'Without a usable joint state for this long, input counts as stale. Above the period '
        'of `joint_states`.', 's', 0.005, 10.0)
    stale_action: str = parameter(
        'fade', 'On stale input the last torque is held for `hold_time`; then it is either faded '
        'to zero or held for ever.', choices=('fade', 'hold'))
    hold_time: float = parameter(
        0.5, 'How long the last torque is held once input is stale.', 's', 0.0, 3600.0)
    fade_time: float = parameter(
        2.0, 'How long the fall to zero torque then takes. Zero torque drops an arm that has no '
        'brakes.', 's', 0.0, 3600.0)

    def __post_init__(self) -> None:
        self.check()

    def check(self, names: tuple[str, ...] = ()) -> None:
        """
        Check what no single parameter shows.

        :param names: the joints of the arm where they are known.
        :raises OptionError: if two parameters contradict each other.
        """
        known = self.joints or names
        n = len(known)
        for name in ('effort_scale', 'max_torque', 'max_torque_rate'):
            count = len(getattr(self, name))
            if n and count not in (0, 1, n):
                raise OptionError(f'parameter {name}: {count} values for {n} joints '
                                  f'({", ".join(known)}); give one for all or one per joint')
        if len(self.joints) > MOST_JOINTS:
            raise OptionError(f'parameter joints: {len(self.joints)} joints; a model takes at '
                              f'most {MOST_JOINTS}')
        if 0.0 in self.effort_scale:
            raise OptionError('parameter effort_scale: 0 would erase the effort of a joint; leave '
                              'the joint out of `joints`')
        for name in ('min_samples', 'first_samples'):
            if getattr(self, name) > self.full_samples:
                raise OptionError(f'parameter {name}: {getattr(self, name)} is more than '
                                  f'full_samples, {self.full_samples}')
        if self.full_samples > self.capacity:
            raise OptionError(f'parameter full_samples: {self.full_samples} is more than '
                              f'capacity, {self.capacity}')


TABLE = tuple(row_of(made) for made in fields(Parameters))
BY_NAME = {row.name: row for row in TABLE}
