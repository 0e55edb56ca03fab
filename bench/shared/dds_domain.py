"""ROS domain that no other process on this machine uses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
import socket

# Ports of domains above 101 may be assigned by the kernel to other processes. The last twenty
# domains are for the demo (examples/demo.py).
DOMAINS = range(1, 81)
# DDS: the ports of domain d are 7400 + 250 d, and 10 and 11 more for its first participant.
BASE, GAIN, USED = 7400, 250, (0, 10, 11)


def in_use(domain: int) -> bool:
    """Return whether a DDS participant uses the domain now."""
    for offset in USED:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('', BASE + GAIN * domain + offset))
            except OSError:
                return True
    return False


@contextmanager
def private_domain() -> Iterator[int]:
    """
    Yield a domain, and reserve it for this process until the context ends.

    The reservation is an abstract socket: it is unique in the network namespace, and the kernel
    releases it when the process ends.
    """
    start = os.getpid() * 37
    for step in range(len(DOMAINS)):
        domain = DOMAINS[(start + step) % len(DOMAINS)]
        with socket.socket(socket.AF_UNIX) as reservation:
            try:
                reservation.bind(f'\0gravity_comp_ros test domain {domain}')
            except OSError:
                continue
            if in_use(domain):
                continue
            yield domain
            return
    raise RuntimeError('every ROS domain of the tests is in use on this machine')
