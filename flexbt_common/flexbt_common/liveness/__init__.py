# SPDX-License-Identifier: BSD-3-Clause
"""Whether others are alive, ready, and there at the other end of a link."""

from .liveliness import (
    LEASE_SECONDS,
    PEER_TIMEOUT,
    PEER_TIMEOUT_TEXT,
    START_SECONDS,
    STARTED,
    LivelinessToken,
    LivelinessWatch,
    tells_liveliness,
)
from .presence import PRESENCE_LEASE_SECONDS, PresenceToken, PresenceWatch

__all__ = [
    'LEASE_SECONDS',
    'PEER_TIMEOUT',
    'PEER_TIMEOUT_TEXT',
    'PRESENCE_LEASE_SECONDS',
    'STARTED',
    'START_SECONDS',
    'LivelinessToken',
    'LivelinessWatch',
    'PresenceToken',
    'PresenceWatch',
    'tells_liveliness',
]
