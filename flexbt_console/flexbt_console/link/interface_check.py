# SPDX-License-Identifier: BSD-3-Clause
"""Whether both sides of a topic were built from the same interfaces.

The middleware connects topics by the name of the type. When the definitions differ, messages are lost or misread
without an error; the hash of the definition, which each side announces, tells (REP 2016).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from flexbt_common.runtime import UNKNOWN_NODE


def interface_problem(node: Any, topic: str) -> str:
    """What is wrong with who is at the other side of a topic that ``node`` publishes or subscribes; empty: nothing."""
    resolved = node.resolve_topic_name(topic)
    publishers = node.get_publishers_info_by_topic(resolved)
    subscriptions = node.get_subscriptions_info_by_topic(resolved)
    own = _hashes(endpoint for endpoint in publishers + subscriptions if _is_of(node, endpoint))
    others = _hashes(subscriptions if any(_is_of(node, endpoint) for endpoint in publishers) else publishers)
    different = sorted(others - own) if own else []
    if not different:
        return ''
    return (
        f'the executive and this console were built from different versions of flexbt_msgs '
        f'({resolved} is {_short(different[0])} there and {_short(min(own))} here); build both from the same one'
    )


def senders_problem(node: Any, topic: str, senders: int) -> str:
    """That more than one publishes on ``topic``; empty when it is not so. ``senders`` is how many are connected."""
    if senders <= 1:
        return ''
    resolved = node.resolve_topic_name(topic)
    publishers = node.get_publishers_info_by_topic(resolved)
    names = [f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in publishers if e.node_name != UNKNOWN_NODE]
    who = f' ({", ".join(sorted(names))})' if names else ''
    return f'{senders} executives publish on {resolved}{who}; end all but one, or give each a namespace of its own'


def _is_of(node: Any, endpoint: Any) -> bool:
    return (endpoint.node_name, endpoint.node_namespace) == (node.get_name(), node.get_namespace())


def _hashes(endpoints: Iterable[Any]) -> set[str]:
    """Without that of an endpoint of an older ROS, which has none: nothing can be said of it."""
    return {str(endpoint.topic_type_hash) for endpoint in endpoints} - {'INVALID'}


def _short(type_hash: str) -> str:
    version, _, value = type_hash.partition('_')
    return f'{version}_{value[:8]}'
