"""Test harness over DDS: the node as a separate process, and a probe node as its counterpart."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import ctypes
import gc
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time

from bench.shared.dds_domain import private_domain
from bench.shared.node_messages import joint_state
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gravity_comp_ros.data.samples import JointSamples
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

ROOT = Path(__file__).resolve().parents[2]
SERVICES = {'payload_changed': Trigger, 'refit': Trigger, 'rollback': Trigger,
            'save_model': Trigger, 'diagnose': Trigger, 'enable': SetBool,
            'set_parameters': SetParameters, 'change_state': ChangeState, 'get_state': GetState}
# Tests kill nodes on purpose. A later process of the same name opens the shared memory of a killed
# one, and `destroy_node` crashed there, so tests use sockets. A range of LOCALHOST enables shared
# memory, regardless of the configured transports. The demo kills no node and uses it.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'
os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(ROOT / 'bench' / 'shared' / 'udp_localhost.xml')
# Many tests wait for the next report, which takes up to a second at the default rate, and send
# recordings, whose stamps are of another day.
QUICK = {'diagnostics_rate': 20.0, 'max_age': 0.0}
PR_SET_PDEATHSIG = 1
# Arguments of Python that run the node.
NODE = ('-m', 'gravity_comp_ros.node.main')
_libc = ctypes.CDLL(None)


def _prepare_child() -> None:
    """End this process with its parent, and restore the default action of Ctrl-C."""
    if sys.platform == 'linux':
        _libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    # A shell ignores SIGINT for background jobs and their children.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def deadline(seconds: float) -> float:
    return time.monotonic() + seconds


class _Statuses(dict[str, DiagnosticStatus]):
    """The last status of each name; an empty one before the first."""

    def __missing__(self, name: str) -> DiagnosticStatus:
        return DiagnosticStatus()


class NodeProcess:
    """The executable of the node, with parameters and in a domain."""

    def __init__(self, domain: int, parameters: dict[str, object] | None = None,
                 arguments: tuple[str, ...] = (),
                 program: tuple[str, ...] = NODE) -> None:
        args = []
        for name, value in (parameters or {}).items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            args += ['-p', f'{name}:={text}']
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1',
                       'PYTHONPATH': os.pathsep.join(p for p in [str(ROOT), *sys.path] if p)}
        # A file, because a full pipe would block the node.
        self._output = tempfile.TemporaryFile('w+')  # noqa: SIM115
        self.process = subprocess.Popen(
            [sys.executable, *program, '--ros-args', *args, *arguments], env=environment,
            stdout=self._output, stderr=subprocess.STDOUT, preexec_fn=_prepare_child)

    def stop(self, number: int = signal.SIGTERM, timeout: float = 10.0) -> tuple[int, str]:
        """Send a signal and return exit code and output."""
        self.process.send_signal(number)
        return self.wait(timeout)

    def wait(self, timeout: float = 10.0) -> tuple[int, str]:
        code = self.process.wait(timeout)
        self._output.seek(0)
        return code, self._output.read()

    def end(self) -> None:
        """Terminate the process, so that it leaves DDS; kill it if it does not end."""
        try:
            self.process.terminate()
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._output.close()


class Probe(Node):
    """Node in the same domain: publishes joint states, keeps the outputs of the node."""

    def __init__(self, context: Context, reliable: bool = True) -> None:
        super().__init__('probe', context=context, start_parameter_services=False)
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self.publisher = self.create_publisher(
            JointState, 'joint_states', QoSProfile(depth=100, reliability=policy))
        self.torques: list[JointState] = []
        self.commands: list[Float64MultiArray] = []
        self.predictions: list[JointState] = []
        self.residuals: list[JointState] = []
        self.extrapolations: list[JointState] = []
        self.status = _Statuses()
        self._outputs: list = []
        self.reports, self.node_time = 0, 0.0
        for kind, topic, into in ((JointState, 'gravity_torques', self.torques),
                                  (Float64MultiArray, 'commands', self.commands),
                                  (JointState, 'prediction', self.predictions),
                                  (JointState, 'residual', self.residuals),
                                  (JointState, 'extrapolation', self.extrapolations)):
            self._outputs.append(
                self.create_subscription(kind, f'/gravity_comp/{topic}', into.append, 1000))
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        # The client that `until_node` uses must be the last.
        self._service_clients = {
            name: self.create_client(kind, f'/gravity_comp/{name}',
                                     qos_profile=QoSProfile(depth=1000))
            for name, kind in SERVICES.items()}
        self._pending: set[Future] = set()
        self.loop = SingleThreadedExecutor(context=context)
        self.loop.add_node(self)

    def end(self) -> None:
        """
        Destroy pending calls, then clients and topics, then the node, then the context.

        The probe has no thread of its own; it is no longer spun.
        """
        for future in list(self._pending):
            future.cancel()
        self._pending.clear()
        self.loop.remove_node(self)
        self.loop.shutdown()
        for client in list(self.clients):
            self.destroy_client(client)
        for subscription in list(self.subscriptions):
            self.destroy_subscription(subscription)
        for publisher in list(self.publishers):
            self.destroy_publisher(publisher)
        self.destroy_node()
        rclpy.shutdown(context=self.context)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.reports += 1
        stamp = message.header.stamp
        self.node_time = stamp.sec + 1e-9 * stamp.nanosec
        for status in message.status:
            self.status[status.name.removeprefix('gravity_comp: ')] = status

    def spin(self, seconds: float) -> None:
        """Handle callbacks for some seconds."""
        end = deadline(seconds)
        while (remaining := end - time.monotonic()) > 0:
            self.loop.spin_once(timeout_sec=remaining)

    def until(self, condition: Callable[[], object], seconds: float = 120.0,
              what: str = 'it') -> None:
        """Handle callbacks until the condition is true; fail at the deadline."""
        end = deadline(seconds)
        while not condition():
            messages = {name: status.message for name, status in self.status.items()}
            assert time.monotonic() < end, \
                f'{what} did not happen within {seconds} s; diagnostics: {messages}'
            self.loop.spin_once(timeout_sec=0.05)

    def until_node(self, node: NodeProcess | None = None) -> None:
        """Wait until the discovery of node and probe is complete in both directions."""
        def ended() -> bool:
            if node is not None and node.process.poll() is not None:
                raise AssertionError(f'the node ended: {node.wait()}')
            return False

        self.until(lambda: not ended() and self.publisher.get_subscription_count() > 0
                   and all(output.get_publisher_count() > 0 for output in self._outputs),
                   60.0, 'the node')
        # Discovery by the probe does not imply discovery by the node. Endpoints are announced in
        # order, so a reply to the last client shows that all are known. A reply sent before
        # discovery is lost: call again.
        self.until(lambda: self.answered('get_state', 2.0), 60.0, 'an answer of the node')

    def report(self, name: str, seconds: float = 60.0):
        """
        Return the status of this name from the second next report.

        The next one may have been sent before the event of interest.
        """
        seen = self.reports
        self.until(lambda: self.reports > seen + 1, seconds, 'two reports')
        return self.status[name]

    def values(self, name: str) -> dict[str, str]:
        """Return the figures of a status."""
        return {pair.key: pair.value for pair in self.status[name].values}

    def answered(self, name: str, seconds: float) -> bool:
        """Call a service and return whether it answered in time."""
        future = self.call_async(name)
        end = deadline(seconds)
        while not future.done() and time.monotonic() < end:
            self.loop.spin_once(timeout_sec=0.05)
        return future.done()

    def call_async(self, name: str, request=None):
        """Call a service of the node and return the future."""
        client = self._service_clients[name]
        self.until(client.service_is_ready, 60.0, f'service {name}')
        future = client.call_async(request or SERVICES[name].Request())
        self._pending.add(future)
        future.add_done_callback(self._pending.discard)
        return future

    def call(self, name: str, seconds: float = 60.0, request=None):
        """Call a service of the node and return its answer."""
        future = self.call_async(name, request)
        self.until(future.done, seconds, f'an answer of {name}')
        return future.result()

    def enable(self, enabled: bool):
        return self.call('enable', request=SetBool.Request(data=enabled))

    def send(self, names, t, q, qd=(), tau=()) -> None:
        """Publish one joint state."""
        self.publisher.publish(joint_state(names, t, q, qd, tau))

    def stream(self, samples, start: float = 0.0, period: float = 0.002) -> None:
        """Publish samples in order with stamps t + start, faster than they were recorded."""
        due = time.monotonic()
        for k in range(len(samples)):
            self.send(samples.names, samples.t[k] + start, samples.q[k], samples.qd[k],
                      samples.tau[k])
            due += period
            self.spin(max(0.0, due - time.monotonic()) or 1e-4)


@contextmanager
def running(parameters: dict[str, object] | None = None, arguments: tuple[str, ...] = (),
            wait: bool = True, reliable: bool = True,
            program: tuple[str, ...] = NODE) -> Iterator[tuple[NodeProcess, Probe]]:
    """Run the node and a probe in a private domain; the node reports 20 times per second."""
    with private_domain() as domain:
        context = Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        node = NodeProcess(domain, {**QUICK, **(parameters or {})}, arguments, program)
        probe = Probe(context, reliable)
        try:
            if wait:
                probe.until_node(node)
            yield node, probe
        finally:
            node.end()
            probe.end()
            # Collect cycles with DDS objects now, not during the next test.
            del probe, context
            gc.collect()


def set_parameter(probe: Probe, name: str, value: object):
    """Set a parameter of the node as ros2 param does; return the result."""
    request = SetParameters.Request(
        parameters=[Parameter(name, value=value).to_parameter_msg()])
    return probe.call('set_parameters', request=request).results[0]


def matrix(messages) -> np.ndarray:
    """Return the efforts of joint states as (M, N)."""
    return np.array([message.effort for message in messages])


def part(samples: JointSamples, start: int, stop: int) -> JointSamples:
    """Return the samples from `start` to `stop`."""
    return samples.select(np.arange(start, stop))


def stamp(message: JointState) -> float:
    """Return the stamp of a message in s."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def until_last(probe: Probe, samples: JointSamples,
               messages: list[JointState] | None = None) -> None:
    """Wait for the answer to the last of these samples; earlier ones may have none."""
    last, sent = round(float(samples.t[-1]), 6), time.monotonic()
    messages = probe.torques if messages is None else messages

    def answered() -> bool:
        nonlocal sent
        if any(round(stamp(m), 6) == last for m in messages):
            return True
        if time.monotonic() - sent > 5.0:
            # Messages are lost while a new subscription is discovered on a busy machine.
            probe.stream(part(samples, len(samples) - 1, len(samples)))
            sent = time.monotonic()
        return False

    probe.until(answered, 60, 'the last answer')


def published(samples: JointSamples, messages: list[JointState]
              ) -> tuple[list[int], np.ndarray]:
    """Return the rows of samples with the stamps of messages, and the efforts of these."""
    rows = {round(t, 6): k for k, t in enumerate(samples.t)}
    # Torque without input has the present time as its stamp.
    known = [m for m in messages if round(stamp(m), 6) in rows]
    return [rows[round(stamp(m), 6)] for m in known], matrix(known)
