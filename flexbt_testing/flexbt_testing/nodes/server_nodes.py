# SPDX-License-Identifier: BSD-3-Clause
"""Nodes of a package of one's own, as its entry point would register them."""

from __future__ import annotations

import threading
from typing import Any, ClassVar

from std_msgs.msg import Bool

from flexbt_core.behavior_tree.engine.asynchronous_actions import CoroutineAction, ThreadedAction
from flexbt_core.behavior_tree.engine.leaf import StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.ports import DOUBLE, STRING, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_server.leaves import TopicCondition
from flexbt_testing.behavior_trees import faulty_leaves as bt_faulty_leaves
from flexbt_testing.waiting import DEADLINE


class Blocks(SyncAction):
    """A leaf that blocks its own tree until the test releases it."""

    release: ClassVar[threading.Event] = threading.Event()
    entered: ClassVar[threading.Event] = threading.Event()

    def tick(self) -> NodeStatus:
        self.entered.set()
        self.release.wait(DEADLINE)
        return NodeStatus.SUCCESS


class Raises(SyncAction):
    """Raises."""

    ports: ClassVar[dict[str, Any]] = {'text': input_port(STRING, default='scripted fault')}

    def tick(self) -> NodeStatus:
        raise RuntimeError(self.get_input('text'))


class Nonsense(SyncAction):
    """A leaf that returns a value that is not a status."""

    def tick(self) -> Any:
        return 'yes'


class NeverRests(StatefulAction):
    """A leaf that runs without end, and never finishes its halt."""

    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        self.context.add_unfinished('a motor that still turns')


class TidiesUp(CoroutineAction):
    """A leaf that runs without end, and needs several ticks to stop."""

    tidied: ClassVar[threading.Event] = threading.Event()

    async def run(self) -> NodeStatus:
        try:
            while True:
                await self.next_tick()
        finally:
            for _ in range(3):
                await self.sleep(0.02)
            self.tidied.set()


class Dozes(CoroutineAction):
    """A leaf that waits by the clock of the tree."""

    ports: ClassVar[dict[str, Any]] = {'seconds': input_port(DOUBLE)}

    async def run(self) -> NodeStatus:
        await self.sleep(self.get_input('seconds'))
        return NodeStatus.SUCCESS


class Naps(ThreadedAction):
    """A leaf that waits by the clock of the tree, in a thread."""

    ports: ClassVar[dict[str, Any]] = {'seconds': input_port(DOUBLE)}

    def run(self) -> NodeStatus:
        self.sleep(self.get_input('seconds'))
        return NodeStatus.SUCCESS


class Counts(SyncAction):
    """A leaf that adds one to an entry."""

    ports: ClassVar[dict[str, Any]] = {'key': input_port(STRING)}

    def tick(self) -> NodeStatus:
        key = self.get_input('key')
        self.blackboard.set(key, self.blackboard.get_or(key, 0) + 1)
        return NodeStatus.SUCCESS


class DoorOpen(TopicCondition):
    """SUCCESS while the last message on 'door' says true."""

    message_type = Bool
    default_topic = 'door'

    def holds(self, message: Any | None) -> bool:
        return message is not None and message.data


def register(registry: NodeRegistry) -> None:
    """Run as the entry point does."""
    registry.register_classes((Blocks, Raises, Nonsense, NeverRests, TidiesUp, Dozes, Naps, Counts, DoorOpen))
    bt_faulty_leaves.register(registry)
