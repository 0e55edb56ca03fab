"""A ROS domain that no other process of this machine is in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
import socket

# Domains above 101 have ports that the kernel hands out to others. The last twenty are the
# demo's (examples/demo.py).
DOMAINS = range(1, 81)
# DDS: ports of a domain begin at 7400 + 250 d; of its first participant, 10 and 11 later.
BASE, GAIN, USED = 7400, 250, (0, 10, 11)


def in_use(domain: int) -> bool:
    """Return whether a participant of DDS is in the domain now."""
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
    Yield a domain, and keep it for this process as long as the context lasts.

    What is held is a socket without a file: unique in the network that DDS uses as well, and
    free again as soon as the process has ended, however it ends.
    """
    start = os.getpid() * 37
    for step in range(len(DOMAINS)):
        domain = DOMAINS[(start + step) % len(DOMAINS)]
        with socket.socket(socket.AF_UNIX) as held:
            try:
                held.bind(f'\0gravity_comp_ros test domain {domain}')
            except OSError:
                continue
            if in_use(domain):
                continue
            yield domain
            return
    raise RuntimeError('every ROS domain of the tests is in use on this machine')
