# SPDX-License-Identifier: BSD-3-Clause
"""Whether both sides of a topic were built from the same interfaces.

The middleware connects topics by the name of the type. When the definitions differ, messages are lost or misread
without an error; the hash of the definition, which each side announces, tells (REP 2016).
"""

from __future__ import annotations

from typing import Any


def interface_problem(node: Any, topic: str, senders: int = 1) -> str:
    """What is wrong with those who publish on ``topic``, seen from a node that subscribes to it; empty when nothing.

    ``senders`` is how many of them are connected.
    """
    resolved = node.resolve_topic_name(topic)
    own = {
        str(endpoint.topic_type_hash)
        for endpoint in node.get_subscriptions_info_by_topic(resolved)
        if (endpoint.node_name, endpoint.node_namespace) == (node.get_name(), node.get_namespace())
    }
    publishers = node.get_publishers_info_by_topic(resolved)
    others = {str(endpoint.topic_type_hash) for endpoint in publishers}
    # An endpoint without a hash comes from an older ROS: nothing can be said of it.
    different = sorted(others - own - {'INVALID'}) if own - {'INVALID'} else []
    if different:
        return (
            f'the executive and this console were built from different versions of flexbt_msgs '
            f'({resolved} is {_short(different[0])} there and {_short(min(own))} here); build both from the same one'
        )
    if senders > 1:
        who = ', '.join(sorted(f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in publishers))
        return (
            f'{senders} executives publish on {resolved} ({who}); end all but one, or give each a namespace of its own'
        )
    return ''


def _short(type_hash: str) -> str:
    version, _, value = type_hash.partition('_')
    return f'{version}_{value[:8]}'
