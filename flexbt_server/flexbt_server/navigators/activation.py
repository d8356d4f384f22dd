# SPDX-License-Identifier: BSD-3-Clause
"""The activation of ``bt_navigator``, which ends when the servers that its default trees call are available.

In Nav2 the lifecycle manager starts planner and controller before bt_navigator, and the nodes of the default tree wait
for their servers. As in Nav2, a server that dies later does not matter here: goals report it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from rclpy.action.server import RCLError

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.behavior_tree.model.definition import NodeDefinition
from flexbt_core.clock.clock import Timer
from flexbt_server.leaves.action_leaf import ActionLeaf
from flexbt_server.leaves.service_leaf import ServiceNode
from flexbt_server.leaves.topic_cache import SubscribedTopic, SubscribesToTopics

ACTIVATION_SECONDS: Final = 60.0
"""Time to wait for the servers, s of wall time. A server that is still missing then may never start: goals report
it."""

_LOOK_SECONDS: Final = 0.1
_TOLD_AFTER: Final = 2.0
"""Time within which processes that start together discover each other, s; missing servers are logged after it."""


class Activation:
    """A wait for servers. Made and used on the executor thread.

    ``is_over``: all servers were available, the time is up, or the wait was canceled. A wait that is not ``patient``
    ends at once and reports missing servers.
    """

    def __init__(self, runtime: Runtime, servers: Mapping[str, str], *, patient: bool) -> None:
        """``servers``: a service of each server, and its name for people."""
        self._runtime = runtime
        self._servers = servers
        self._patient = patient
        self._began = runtime.steady.now()
        self._is_told = False
        self._timer: Timer | None = None
        self.is_over = False
        self._look()

    def cancel(self) -> None:
        """Stop waiting."""
        self.is_over = True
        if self._timer is not None:
            self._timer.cancel()

    def _look(self) -> None:
        if self.is_over:
            return
        steady, logger = self._runtime.steady, self._runtime.node.get_logger()
        missing = ', '.join(name for service, name in self._servers.items() if not self._is_there(service))
        waited = steady.now() - self._began
        if not missing or not self._patient or waited >= ACTIVATION_SECONDS:
            self.is_over = True
            if missing:
                logger.warning(
                    f'{names.BT_NAVIGATOR} is active without servers that its default trees call, which were not there '
                    f'after {waited:.0f} s: {missing}'
                )
            elif self._is_told:
                logger.info(f'{names.BT_NAVIGATOR} is active: the servers of its default trees are there')
            return
        if waited >= _TOLD_AFTER and not self._is_told:
            self._is_told = True
            logger.info(f'{names.BT_NAVIGATOR} is not active yet: its default trees need {missing}')
        self._timer = self._runtime.post_in(_LOOK_SECONDS, self._look)

    def _is_there(self, service: str) -> bool:
        node = self._runtime.node
        try:
            return bool(node.count_services(node.resolve_service_name(service)))
        except RCLError:
            return False  # the name is not valid for a server


# The servers that a tree calls and the topics that it subscribes to, as far as its XML shows them.


def called_servers(nodes: Iterable[NodeDefinition]) -> dict[str, str]:
    """Return the servers of the action and service leaves among ``nodes``: the name of a service that shows in the
    graph that the server exists, and the name of the server in the tree.

    Servers whose names come from the blackboard are left out, since only the run knows them.
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
    """Yield the topics that ``nodes`` subscribe to, by their names in the tree.

    Topics whose names come from the blackboard are left out, since only the run knows them.
    """
    for node in nodes:
        leaf = node.manifest.node_class
        for topic in leaf.subscribes_to() if issubclass(leaf, SubscribesToTopics) else ():
            name = _name(node, topic.port, topic.name)
            if name:
                yield topic._replace(name=name)


def _name(node: NodeDefinition, port: str, default: str) -> str:
    """Return the name of the server or topic of a leaf; '' if it comes from the blackboard."""
    given = node.values.get(port)
    if given is None:
        return default
    return '' if given.key is not None else given.text or default
