# SPDX-License-Identifier: BSD-3-Clause
"""A ROS domain of its own for a demonstration, so that it neither disturbs nor hears other robots."""

from __future__ import annotations

import contextlib
import os
import random
import socket
from collections.abc import Iterable, Iterator

# ROS's domain_coordinator, with which tests keep their domains apart: whoever binds TCP port 32768 + N owns
# domain N. The system closes the port when its holder ends, in whatever way.
COORDINATION_PORT = 32768
DOMAINS = range(1, 101)

# RTPS 2.5, 9.6.2.3: unicast discovery port of the first participant of a domain.
DISCOVERY_PORT = 7410
DISCOVERY_PORT_STEP = 250


class NoFreeDomainError(RuntimeError):
    """Every domain is taken on this computer."""


@contextlib.contextmanager
def own_domain(candidates: Iterable[int] | None = None) -> Iterator[int]:
    """Keep a ROS domain for the time of the context, in ROS_DOMAIN_ID, and give its number.

    An explicit ROS_DOMAIN_ID is respected and not reserved: then the user wants to meet other nodes there.
    Otherwise a domain is taken that nobody has reserved and in which no participant runs on this computer.
    Raises NoFreeDomainError when there is none.
    """
    chosen = os.environ.get('ROS_DOMAIN_ID', '')
    if chosen:
        yield int(chosen)
        return
    with contextlib.ExitStack() as reservation:
        domain = _reserve(list(candidates or random.sample(DOMAINS, len(DOMAINS))), reservation)
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        reservation.callback(os.environ.pop, 'ROS_DOMAIN_ID', None)
        yield domain


def _reserve(candidates: list[int], reservation: contextlib.ExitStack) -> int:
    for domain in candidates:
        holder = _bind(socket.SOCK_STREAM, COORDINATION_PORT + domain)
        if holder is None:
            continue
        participant = _bind(socket.SOCK_DGRAM, DISCOVERY_PORT + DISCOVERY_PORT_STEP * domain)
        if participant is None:
            holder.close()
            continue
        participant.close()
        reservation.enter_context(holder)
        return domain
    raise NoFreeDomainError(f'no free ROS domain among {len(candidates)}: set ROS_DOMAIN_ID to one that may be used')


def _bind(kind: socket.SocketKind, port: int) -> socket.socket | None:
    holder = socket.socket(socket.AF_INET, kind)
    try:
        holder.bind(('', port))
    except OSError:
        holder.close()
        return None
    return holder
