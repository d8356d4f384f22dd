# SPDX-License-Identifier: BSD-3-Clause
"""The debugger of trees for operators: their commands go to the BT server, and its state goes into the status.

The BT server keeps what was set, and the trees that it holds. The executive checks who may command, as for all
commands, and shows all operators the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from rclpy.event_handler import SubscriptionEventCallbacks

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.errors import LimitExceededError
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.state_machine.engine.events import CommandDecided
from flexbt_core.values.text import one_line
from flexbt_msgs.msg import ExecutiveCommand, TreeBreakpoint, TreeDebugging, TreeHold, TreeStatus
from flexbt_msgs.srv import ControlTree
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.peers import PeersWatch

MOST_BREAKPOINTS: Final = 100
"""Maximum number of breakpoints in a status."""

MOST_HOLDS: Final = 20
"""Maximum number of held trees in a status."""

MESSAGE_BYTES: Final = 1_000_000

ANSWER_SECONDS: Final = 3.0
"""Time within which the BT server has to appear, and again to answer, s. The answer to a step comes after its tick."""

_RESULTS: Final = {'SUCCESS': TreeStatus.SUCCESS, 'FAILURE': TreeStatus.FAILURE}


class TreeDebuggingLink:
    """The link to the debugger of the BT server. Used on the executor thread."""

    def __init__(
        self, runtime: Runtime, services: ServiceLinks, peers: PeersWatch, changed: Callable[[], None]
    ) -> None:
        """Create the link; it calls ``changed`` when the status has to be sent."""
        self._link = services.link(ControlTree, names.CONTROL_TREE)
        self._peers = peers
        self._changed = changed
        self._shown = TreeDebugging()
        self._servers = 0
        self._error = runtime.node.get_logger().error
        ReceivedMessages(
            runtime.node,
            TreeDebugging,
            names.TREE_DEBUGGING,
            names.transient_local_qos(),
            self._receive,
            MESSAGE_BYTES,
            event_callbacks=SubscriptionEventCallbacks(matched=self._matched),
        )

    @property
    def breakpoints(self) -> list[TreeBreakpoint]:
        """What is set in the BT server; nothing while that is gone, since it keeps it in its memory."""
        return [] if self._is_gone else self._shown.breakpoints[:MOST_BREAKPOINTS]

    @property
    def holds(self) -> list[TreeHold]:
        """The trees that are held or paused."""
        return [] if self._is_gone else self._shown.holds[:MOST_HOLDS]

    @property
    def _is_gone(self) -> bool:
        return not self._servers or self._shown.server in self._peers.gone()

    def _matched(self, status: Any) -> None:
        self._servers = status.current_count
        self._changed()

    def send(self, sent: ExecutiveCommand, command: int, decided: Callable[[CommandDecided], None]) -> None:
        """Send a command of an operator to the BT server; ``decided`` gets its result.

        Raises:
            CommandRefusedError: it names a result that no node can be given.
        """
        if sent.outcome and sent.outcome not in _RESULTS:
            raise CommandRefusedError(f'a node can be given the result SUCCESS or FAILURE, not {sent.outcome!r}')
        request = ControlTree.Request(
            command=command,
            run_id=sent.tree_run_id,
            behavior_tree=sent.behavior,
            node=sent.path,
            condition=sent.text,
            status=_RESULTS.get(sent.outcome, TreeStatus.IDLE),
            operator_id=sent.operator_id,
        )

        def done(outcome: ServiceOutcome) -> None:
            response = outcome.response
            late = f'{outcome.reason}; if the BT server has received it, it may have its effect later'
            reason = late if response is None else response.message
            is_done = response is not None and response.success
            decided(CommandDecided(sent.id, None if is_done else reason or 'the BT server has refused it'))

        ServiceCall(self._link, request, on_done=done, server_timeout=ANSWER_SECONDS, response_timeout=ANSWER_SECONDS)

    def _receive(self, received: Received) -> None:
        try:
            self._shown = received.checked(TreeDebugging)
        except (ValueError, LimitExceededError) as error:
            self._error(f'{names.TREE_DEBUGGING}: ignored: {one_line(str(error))}', throttle_duration_sec=10.0)
            return
        self._changed()
