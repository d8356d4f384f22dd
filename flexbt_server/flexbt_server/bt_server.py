# SPDX-License-Identifier: BSD-3-Clause
"""The managed node ``bt_server``: it loads behavior trees and runs them. A separate thread reads files.

It offers the actions ``bt_loader``, ``bt_executor``, ``bt_get_data`` and ``bt_set_data`` (defined in flexbt_msgs), the
topics ``tree_structure``, ``tree_status`` and ``tree_debugging``, and the services ``control_tree`` and
``get_tree_blackboard``.
"""

from __future__ import annotations

import sys
import threading
from typing import Final

from geometry_msgs.msg import PoseStamped

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks
from flexbt_common.calls.goal_server import GoalAdmission
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.lifecycle.managed_node import SHUTTING_DOWN, run_managed_node
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.behavior_tree.model.blackboard_json import JsonTypes
from flexbt_core.clock.work_thread import LateWork, WorkThread
from flexbt_core.errors import FlexbtError
from flexbt_msgs.msg import BtLoadReport
from flexbt_server.actions.control_server import ControlServer
from flexbt_server.actions.data_servers import DataServers, LoadServer
from flexbt_server.actions.execute_server import ExecuteServer
from flexbt_server.actions.tree_goals import TreeGoals
from flexbt_server.leaves.leaf_services import EndingGoals, LeafServices, RobotFrames, TriggerServices
from flexbt_server.leaves.topic_cache import SubscribedTopic, TopicCaches
from flexbt_server.navigators.activation import subscribed_topics
from flexbt_server.navigators.bt_navigator import Navigators
from flexbt_server.runs.run_events import RunWatcher
from flexbt_server.runs.run_logs import Groot2Runs, RunLogs, TreeDocuments, TreeLogs
from flexbt_server.runs.tree_debugger import TreeDebugger
from flexbt_server.runs.tree_stream import TreeStream
from flexbt_server.trees.blackboards import Blackboards
from flexbt_server.trees.ros_ports import RosJsonTypes
from flexbt_server.trees.tree_store import FoundTree, TreeStore

from .errors import BtServerError, ServerParameterError, UnknownTreeError
from .node_types import node_registry
from .parameters import DEFAULT_TREES, NavigatorParameters, ServerParameters, declare_parameters

_END_SECONDS = 1.1
"""Time for which the process waits at its end for running trees to halt, s."""


class BtServer:
    """The parts of the server, on a running node."""

    def __init__(self, runtime: Runtime, refusal: str = '') -> None:
        """Create the server, off the executor thread. ``refusal``: why it refuses all goals until its activation.

        Raises:
            FlexbtError: a parameter cannot work, or a file of ``preload`` is refused.
        """
        parameters = runtime.call(lambda: declare_parameters(runtime.node))
        logger = runtime.node.get_logger()
        runtime.default_context.open()

        def broken(nodes: str, error: Exception) -> None:
            why = str(error) if isinstance(error, FlexbtError) else repr(error)
            logger.error(f'{nodes} not added: {why}')

        registry = node_registry(broken, parameters.nav2_branch)
        self._plugins: list[RunWatcher] = []
        if parameters.plugins:
            from .cpp_nodes import start_hosts  # its import takes time, and few servers need it

            self._plugins += start_hosts(runtime, parameters.plugins, registry, broken)
        allowed = (*parameters.allowed_directories, *parameters.navigators.trusted)
        topics = TopicCaches(runtime)
        store = TreeStore(
            registry,
            allowed,
            parameters.max_file_size,
            parameters.max_depth,
            parameters.max_loaded_memory,
            on_loaded=lambda nodes: topics.subscribe(subscribed_topics(nodes)),
        )
        self._preload(store, parameters.preload)
        for file in parameters.navigators.found_files:
            for reason in store.load([str(file)])[0].errors:
                logger.error(f'not loaded: {reason}')
        default_trees = self._default_trees(store, parameters.navigators)
        store.keep_loaded()
        boards = Blackboards()
        services = LeafServices(
            runtime=runtime,
            actions=ActionLinks(runtime, parameters.peer_timeout),
            services=ServiceLinks(runtime, parameters.peer_timeout),
            topics=topics,
            triggers=TriggerServices(runtime),
            ending=EndingGoals(runtime, parameters.cancel_timeout),
            frames=RobotFrames(
                runtime,
                topics.cache(SubscribedTopic(PoseStamped, parameters.pose_topic)),
                parameters.navigators.global_frame,
                parameters.robot_base_frame,
            ),
            trees=store,
            server_timeout=parameters.server_timeout,
            cancel_timeout=parameters.cancel_timeout,
            start_timeout=parameters.start_timeout,
            goal_reached_tol=parameters.goal_reached_tol,
        )
        reader = self._reader = runtime.call(lambda: tree_reader(runtime))
        admission = self._admission = GoalAdmission('the BT server', refusal)

        types = RosJsonTypes(registry.json_types)
        debugger = runtime.call(lambda: TreeDebugger(runtime))
        watchers = [debugger, *runtime.call(lambda: self._watchers(runtime, parameters, types))]
        goals = self.goals = runtime.call(
            lambda: TreeGoals(runtime, parameters, store, boards, services, reader, watchers)
        )
        self.execute = runtime.call(lambda: ExecuteServer(runtime, parameters.default_tree, goals, boards, admission))
        self.control = runtime.call(lambda: ControlServer(runtime, goals, debugger, store, reader))
        self.load = runtime.call(lambda: LoadServer(runtime, store, reader, admission))
        self.data = runtime.call(lambda: DataServers(runtime, boards, reader, goals, admission))
        self.navigators = runtime.call(
            lambda: Navigators(runtime, parameters.navigators, goals, boards, services, default_trees, refusal)
        )
        self._call = runtime.call
        self.alive = LivelinessToken(runtime)
        runtime.on_close(lambda: self._end(runtime))
        self._log = logger.info
        self._log(f'configured: {len(registry)} node types, {len(store.library.tree_ids())} trees loaded')

    def activate(self) -> None:
        """Accept goals."""
        self._admission.open()
        self._call(self.navigators.activate)
        self._log('active')

    def deactivate(self, why: str, refusal: str, within: float) -> None:
        """Refuse goals, stop every tree and wait until all goals have their results. Not on the executor thread.

        ``why`` (for running trees) and ``refusal`` follow a subject; ``within`` is in seconds of wall time.

        Raises:
            BtServerError: a tree did not halt in this time.
        """
        is_at_rest = self._stop(why, refusal, within)
        is_read = self._reader.is_done_within(within)
        if not (is_read and is_at_rest):
            raise BtServerError(
                f'{"a tree is running" if is_read else "a file is being read"} {within:g} s after the stop'
            )
        self._log(f'the BT server {refusal}')

    def _end(self, runtime: Runtime) -> None:
        runtime.post_in(_END_SECONDS / 2, runtime.default_context.shut_down)  # ends a leaf that loops over rclpy.ok()
        if not self._stop(SHUTTING_DOWN, SHUTTING_DOWN, _END_SECONDS):
            runtime.fail(f'a tree was running {_END_SECONDS:g} s after the stop; leaving it')

    def _stop(self, why: str, refusal: str, within: float) -> bool:
        self._admission.close(refusal)
        self._call(lambda: self.navigators.deactivate(refusal))
        return self.goals.stop_all(f'the BT server {why}', within)

    def _watchers(self, runtime: Runtime, parameters: ServerParameters, types: JsonTypes) -> list[RunWatcher]:
        watchers = [*self._plugins]
        if parameters.groot2_port:
            watchers.append(
                Groot2Runs(runtime, parameters.groot2_port, parameters.groot2_address, parameters.groot2_tree, types)
            )
        if parameters.btlog_directory is not None:
            watchers.append(RunLogs(runtime, parameters.btlog_directory, parameters.btlog_keep))
        has_navigators = bool(parameters.navigators.navigators)
        if has_navigators or parameters.publish_statuses:
            watchers.append(TreeLogs(runtime, always=has_navigators))
        if parameters.publish_statuses:
            watchers += [TreeStream(runtime), TreeDocuments(runtime)]
        return watchers

    def _preload(self, store: TreeStore, files: tuple[str, ...]) -> None:
        reports = store.load(files) if files else []
        refused = [str(error) for report in reports if report.code == BtLoadReport.REFUSED for error in report.errors]
        if refused:
            raise ServerParameterError(f"parameter 'preload': {'; '.join(refused)}")

    def _default_trees(self, store: TreeStore, navigators: NavigatorParameters) -> list[FoundTree]:
        found = []
        for name, tree in navigators.default_trees.items():
            try:
                found.append(store.find(tree))
            except UnknownTreeError as error:
                raise ServerParameterError(f'parameter {DEFAULT_TREES[name]!r}: {error}') from None
        return found


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``bt_server``."""
    return run_managed_node(names.BT_SERVER, BtServer, args, parameters=declare_parameters, about=__doc__)


# The thread that reads the files of trees and the values of blackboards, in the order of the goals.

READ_SECONDS: Final = 5.0
"""Time for reading the files of one goal, s. If it takes longer and the reader thread does not use the processor
either, the disk does not answer, and the server is not ready."""

SLOW_SECONDS: Final = 60.0
"""Time, s, after which the server is not ready although the reader thread uses the processor: the read may never end.
Until then a slow read is only logged."""

_FILES: Final = 'files'
"""The part of the server that is reported as not ready then."""

_SLOW: Final = 'it is still being read: smaller files, or a faster computer'


def tree_reader(runtime: Runtime) -> WorkThread:
    """Return a reader that lives until the end of the node. Describe each job by what did not happen if it is late:
    'tree x was not read'."""
    token = LivelinessToken(runtime)
    lock = threading.Lock()
    is_open, reported = True, ''

    def late(work: LateWork | None) -> None:
        nonlocal reported
        reason = _reason(work)
        with lock:
            if not is_open or reason == reported:  # after the close, the token belongs to another reader
                return
            reported, why = reason, ''
            if work is not None:
                why = f'{work.what} within {work.seconds:g} s, goals wait: {reason}'
                runtime.node.get_logger().warning(why)
            token.set_ready(reason in ('', _SLOW), _FILES, why)

    def fault(error: BaseException) -> None:
        runtime.post(lambda: runtime.report_fault(error, 'the thread that reads trees'))

    reader = WorkThread('tree_reader', runtime.steady, READ_SECONDS, late, fault)

    def close() -> None:
        """Remove the report of a read that may never end from the token, which the node keeps."""
        nonlocal is_open
        reader.close()
        with lock:
            is_open = False
            token.set_ready(True, _FILES)

    runtime.on_close(close)
    return reader


def _reason(work: LateWork | None) -> str:
    """Return the reason why reading is slow, or ''."""
    if work is None:
        return ''
    if not work.uses_processor:
        return 'does the disk answer?'
    return _SLOW if work.seconds < SLOW_SECONDS else 'it is still being read, and may never end'


if __name__ == '__main__':
    sys.exit(main())
