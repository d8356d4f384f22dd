# SPDX-License-Identifier: BSD-3-Clause
"""A separate ROS domain for robots that are started here, so that they and other robots do not interfere."""

from __future__ import annotations

import contextlib
import os
import random
import socket
from collections.abc import Iterable, Iterator

# Like ROS's domain_coordinator, which separates the domains of tests: the process that binds TCP port 32768 + N owns
# domain N. The system closes the port when its holder ends, however it ends.
COORDINATION_PORT = 32768
DOMAINS = range(1, 101)

# RTPS 2.5, 9.6.2.3: unicast discovery port of the first participant of a domain.
DISCOVERY_PORT = 7410
DISCOVERY_PORT_STEP = 250
LAST_DOMAIN = 232  # the last one whose ports exist


class NoFreeDomainError(RuntimeError):
    """No ROS domain can be used: all on this computer are in use, or ROS_DOMAIN_ID is none."""


@contextlib.contextmanager
def own_domain(candidates: Iterable[int] | None = None) -> Iterator[int]:
    """Reserve a ROS domain in ROS_DOMAIN_ID while the context is open, and yield its number.

    An explicit ROS_DOMAIN_ID is used and not reserved, because the user wants to reach other nodes there. Otherwise
    choose a domain that is not reserved and has no participant on this computer. Raises NoFreeDomainError if none is
    left, or if ROS_DOMAIN_ID is no domain.
    """
    chosen = os.environ.get('ROS_DOMAIN_ID', '')
    if chosen:
        if not chosen.isdecimal() or int(chosen) > LAST_DOMAIN:
            raise NoFreeDomainError(f'ROS_DOMAIN_ID is {chosen!r}; it has to be a number from 0 to {LAST_DOMAIN}')
        yield int(chosen)
        return
    with reserved_domain(candidates) as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        try:
            yield domain
        finally:
            os.environ.pop('ROS_DOMAIN_ID', None)


@contextlib.contextmanager
def reserved_domain(candidates: Iterable[int] | None = None) -> Iterator[int]:
    """Reserve a domain while the context is open, and yield its number. Raises NoFreeDomainError if none is left."""
    wanted = list(candidates or random.sample(DOMAINS, len(DOMAINS)))
    for domain in wanted:
        holder = _bind(socket.SOCK_STREAM, COORDINATION_PORT + domain)
        if holder is None:
            continue
        participant = _bind(socket.SOCK_DGRAM, DISCOVERY_PORT + DISCOVERY_PORT_STEP * domain)
        if participant is None:
            holder.close()
            continue
        participant.close()
        with holder:
            yield domain
        return
    raise NoFreeDomainError(f'no free ROS domain among {len(wanted)}: set ROS_DOMAIN_ID to one that may be used')


def _bind(kind: socket.SocketKind, port: int) -> socket.socket | None:
    holder = socket.socket(socket.AF_INET, kind)
    try:
        holder.bind(('', port))
    except OSError:
        holder.close()
        return None
    return holder
