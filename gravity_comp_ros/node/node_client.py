"""Client of a running node: predictions, residuals and diagnostics, in a separate thread."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from datetime import datetime
from threading import Lock, Thread
import time

from diagnostic_msgs.msg import DiagnosticArray
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.node.diagnostics import Status
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

# Time slot, s, of which the row with the largest residual is kept.
_SLOT = 0.02
_MAX_ROWS, _MAX_EVENTS, _MAX_PENDING = 6000, 200, 200
# Time after which the thread checks whether to end, s.
_WAIT = 0.2


class NodeClient:
    """
    Keeps the last minutes of predictions and residuals of a node, and its diagnostics.

    No method blocks.

    :param node: name of the node, such as `gravity_comp`.
    :raises OptionError: if it is no valid name.
    """

    def __init__(self, node: str) -> None:
        self.node = f'/{node.strip("/")}'
        self._lock = Lock()
        self._names: tuple[str, ...] = ()
        self._rows: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=_MAX_ROWS)
        self._count = 0
        self._first: float | None = None
        self._pending: dict[tuple[int, int], JointState] = {}
        self._slot: tuple[int, float, float, FloatArray, FloatArray] | None = None
        self._low, self._high = np.zeros(0), np.zeros(0)
        self._statuses: dict[str, Status] = {}
        self._heard: dict[str, float] = {}
        self._events: deque[tuple[str, str]] = deque(maxlen=_MAX_EVENTS)
        self._context = Context()
        rclpy.init(context=self._context)
        self._listener = Node('gravity_comp_workbench', context=self._context,
                              start_parameter_services=False, enable_rosout=False)
        self._subscribe()
        self._closing = False
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._listener)
        self._thread = Thread(target=self._spin, name='follow', daemon=True)
        self._thread.start()

    def joints(self) -> tuple[str, ...]:
        """Return the joint names, none before the first message."""
        return self._names

    def rows(self, after: int) -> tuple[int, FloatArray, FloatArray, FloatArray]:
        """
        Return the rows after row number `after`.

        :return: number of the last row, time (K,) in s, measured and predicted torque (K, N)
            in N·m.
        """
        with self._lock:
            new = min(self._count - after, len(self._rows))
            kept = list(self._rows)[len(self._rows) - new:] if new > 0 else []
            count, n = self._count, len(self._names)
        if not kept:
            return count, np.zeros(0), np.zeros((0, n)), np.zeros((0, n))
        t, measured, predicted = zip(*kept)
        return count, np.array(t), np.array(measured), np.array(predicted)

    def coverage(self) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and largest angle of each joint (N,) in rad."""
        with self._lock:
            return self._low.copy(), self._high.copy()

    def statuses(self) -> Sequence[Status]:
        """Return the last diagnostics of the node."""
        with self._lock:
            return list(self._statuses.values())

    def events(self) -> Sequence[tuple[str, str]]:
        """Return time and text of each change of the diagnostics, the latest last."""
        with self._lock:
            return list(self._events)

    def ages(self) -> tuple[float | None, float | None]:
        """Return the age in s of the last torque and of the last status, None before the first."""
        now = time.monotonic()
        torque, status = (self._heard.get(kind) for kind in ('torque', 'status'))
        return (None if torque is None else now - torque,
                None if status is None else now - status)

    def close(self) -> None:
        """End the thread and destroy the ROS node of this client."""
        self._closing = True
        self._executor.wake()
        self._thread.join(2.0)
        if self._thread.is_alive():
            # The thread uses these objects; it ends with the process.
            return
        # Users before the objects that they use.
        self._executor.shutdown()
        self._listener.destroy_node()
        self._context.try_shutdown()

    def _subscribe(self) -> None:
        best = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
        try:
            self._listener.create_subscription(JointState, f'{self.node}/prediction',
                                               self._on_prediction, best)
        except InvalidTopicNameException as problem:
            raise OptionError(f'--live: {self.node} is no valid name of a node') from problem
        self._listener.create_subscription(JointState, f'{self.node}/residual',
                                           self._on_residual, best)
        self._listener.create_subscription(DiagnosticArray, '/diagnostics',
                                           self._on_diagnostics, 10)

    def _spin(self) -> None:
        try:
            while not self._closing and self._context.ok():
                self._executor.spin_once(timeout_sec=_WAIT)
        except (ExternalShutdownException, rclpy.exceptions.ROSInterruptException):
            pass

    def _on_prediction(self, message: JointState) -> None:
        stamp = message.header.stamp
        self._pending[stamp.sec, stamp.nanosec] = message
        while len(self._pending) > _MAX_PENDING:
            del self._pending[next(iter(self._pending))]

    def _on_residual(self, message: JointState) -> None:
        stamp = message.header.stamp
        prediction = self._pending.pop((stamp.sec, stamp.nanosec), None)
        if prediction is None or prediction.name != message.name:
            return
        residual, predicted = np.array(message.effort), np.array(prediction.effort)
        if residual.shape != predicted.shape or len(residual) != len(message.name):
            return
        with self._lock:
            self._heard['torque'] = time.monotonic()
            if tuple(message.name) != self._names:
                self._start(tuple(message.name))
            q = np.array(message.position)
            if q.shape == self._low.shape:
                self._low, self._high = np.minimum(self._low, q), np.maximum(self._high, q)
            self._keep(stamp.sec + 1e-9 * stamp.nanosec, residual, predicted)

    def _start(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._rows.clear()
        self._slot = None
        self._low, self._high = np.full(len(names), np.inf), np.full(len(names), -np.inf)

    def _keep(self, t: float, residual: FloatArray, predicted: FloatArray) -> None:
        """Keep the row of each slot of time whose residual is the largest."""
        self._first = t if self._first is None else self._first
        slot, size = int(t / _SLOT), float(np.abs(residual).max())
        last = self._slot
        if last is not None and last[0] != slot:
            self._rows.append((last[2] - self._first, last[3] + last[4], last[4]))
            self._count += 1
            last = None
        if last is None or size > last[1]:
            self._slot = (slot, size, t, residual, predicted)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        name = self.node.lstrip('/')
        with self._lock:
            for status in message.status:
                if not status.name.startswith(f'{name}: '):
                    continue
                self._heard['status'] = time.monotonic()
                part = status.name[len(name) + 2:]
                new = Status(part, int.from_bytes(status.level, 'little'), status.message)
                old = self._statuses.get(part)
                self._statuses[part] = new
                if _is_change(old, new):
                    when = datetime.fromtimestamp(time.time()).strftime('%H:%M:%S')
                    self._events.append((when, f'{part}: {new.message}'))


def _is_change(old: Status | None, new: Status) -> bool:
    """Return whether a status has changed in more than its figures."""
    if old is None or old.level != new.level:
        return True
    return new.name in ('learning', 'model') and (
        _without_figures(old.message) != _without_figures(new.message))


def _without_figures(text: str) -> str:
    return ''.join(c for c in text if not (c.isdigit() or c in '.+-'))
