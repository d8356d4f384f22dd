# SPDX-License-Identifier: BSD-3-Clause
"""The servers that a tree calls, and the topics that it subscribes to, as far as its XML tells."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from flexbt_core.behavior_tree import NodeDefinition

from .action_leaf import ActionLeaf
from .service_leaf import ServiceNode
from .topic_cache import SubscribedTopic, SubscribesToTopics


def called_servers(nodes: Iterable[NodeDefinition]) -> dict[str, str]:
    """The servers of the action and service leaves among ``nodes``: names of services that are in the graph when they
    are there, and what trees call them.

    A server whose name comes from the blackboard, which only the run knows, is not among them.
    """
    found = {}
    for node in nodes:
        leaf = node.manifest.node_class
        if issubclass(leaf, ActionLeaf):
            name = _name(node, 'server_name', leaf.default_server)
            found[f'{name}/_action/send_goal'] = name
        elif issubclass(leaf, ServiceNode):
            name = _name(node, 'service_name', leaf.default_service)
            found[name] = name
    return {service: name for service, name in found.items() if name}


def subscribed_topics(nodes: Iterable[NodeDefinition]) -> Iterator[SubscribedTopic]:
    """The topics that ``nodes`` subscribe to, by their names in the tree.

    One whose name comes from the blackboard, which only the run knows, is not among them.
    """
    for node in nodes:
        leaf = node.manifest.node_class
        for topic in leaf.subscribes_to() if issubclass(leaf, SubscribesToTopics) else ():
            name = _name(node, topic.port, topic.name)
            if name:
                yield topic._replace(name=name)


def _name(node: NodeDefinition, port: str, default: str) -> str:
    """What a leaf calls, or subscribes to; '' when the blackboard has it."""
    given = node.values.get(port)
    if given is None:
        return default
    return '' if given.key is not None else given.text or default
