# SPDX-License-Identifier: BSD-3-Clause
"""The operator and the leaf's action server of the benchmark against FlexBE.

Usage: _flexbe_probe.py SPECIFICATION.json OUTPUT.json, as flexbe.py gives them.
"""

from __future__ import annotations

import json
import random
import sys
import time
import zlib
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol

from _flexbe_native import ACTION
from _flexbe_stamp import Entries
from nav2_msgs.action import Wait

from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.runtime.node_runtime import NodeRuntime

DEADLINE: Final = 30.0
RESULT_DEADLINE: Final = 3.0
"""How long the operator waits for a result before it is taken to be lost, s."""

REST_SECONDS: Final = 2.0
SETTLE_SECONDS: Final = 0.3


class Server:
    """Ends each goal after a random time, and notes when: the result is on its way then."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self.seconds = (0.0, 0.0)
        self.result_sent = 0
        runtime.call(lambda: GoalServer(runtime, Wait, ACTION, self._serve))

    def _serve(self, goal: ServedGoal) -> None:
        steady = self._runtime.steady
        until = steady.now() + random.uniform(*self.seconds)
        steady.call_at(until, lambda: self._runtime.post(lambda: self._end(goal)))

    def _end(self, goal: ServedGoal) -> None:
        self.result_sent = time.monotonic_ns()
        goal.succeed(Wait.Result())


class Operator(Protocol):
    """Commands an executive."""

    def start(self, behavior: str, arguments: dict[str, str]) -> None: ...

    def force(self, state: str, outcome: str) -> None:
        """Leave the state by its first outcome, which is this one."""

    def stop(self) -> None: ...

    def told(self) -> str:
        """Return what the executive has said last."""


class FlexbtOperator:
    """Commands FlexBT's executive."""

    def __init__(self, runtime: NodeRuntime) -> None:
        from flexbt_msgs.msg import ExecutiveCommand
        from flexbt_testing.nodes.operator import Operator

        self._kinds = ExecutiveCommand
        self._operator = Operator(runtime, 'benchmark')
        self._operator.wait_connected()

    def start(self, behavior: str, arguments: dict[str, str]) -> None:
        self._operator.start(behavior, arguments=arguments)

    def force(self, state: str, outcome: str) -> None:
        self._operator.send(self._kinds.FORCE, path=f'/{state}', outcome=outcome)

    def stop(self) -> None:
        self._operator.send(self._kinds.STOP)
        self._operator.wait_idle()

    def told(self) -> str:
        return f'status {self._operator.status}'


class FlexbeOperator:
    """Commands FlexBE's onboard executive, as its user interface does."""

    def __init__(self, runtime: NodeRuntime, key: str, source: Path) -> None:
        from flexbe_msgs.msg import BehaviorLog, BehaviorSelection, BEStatus, OutcomeRequest
        from std_msgs.msg import Empty

        self._selection_type, self._outcome_type, self._empty_type = BehaviorSelection, OutcomeRequest, Empty
        self._ready = BEStatus.READY
        self._codes: list[int] = []
        self._log: deque[str] = deque(maxlen=10)
        self._key = _checksum(key)
        self._id = _checksum(source.read_text(encoding='utf-8'))

        def join() -> None:
            node = runtime.node
            node.create_subscription(BEStatus, 'flexbe/status', self._on_status, 10)
            node.create_subscription(BehaviorLog, 'flexbe/log', lambda line: self._log.append(line.text), 10)
            self._starts = node.create_publisher(BehaviorSelection, 'flexbe/start_behavior', 10)
            self._outcomes = node.create_publisher(OutcomeRequest, 'flexbe/command/transition', 10)
            self._preempts = node.create_publisher(Empty, 'flexbe/command/preempt', 10)

        runtime.call(join)
        _until(self._starts.get_subscription_count, 'no executive of FlexBE')

    def _on_status(self, status: Any) -> None:
        self._codes.append(status.code)

    def start(self, behavior: str, arguments: dict[str, str]) -> None:
        self._starts.publish(
            self._selection_type(
                behavior_key=self._key,
                behavior_id=self._id,
                autonomy_level=3,
                arg_keys=list(arguments),
                arg_values=list(arguments.values()),
            )
        )
        _until(self._outcomes.get_subscription_count, f'{behavior} was not started')

    def force(self, state: str, outcome: str) -> None:
        self._outcomes.publish(self._outcome_type(outcome=0, target=state))

    def stop(self) -> None:
        self._codes.clear()
        self._preempts.publish(self._empty_type())
        _until(lambda: self._ready in self._codes, 'FlexBE does not stop')

    def told(self) -> str:
        return f'status codes {self._codes}, log {list(self._log)}'


def _checksum(text: str) -> int:
    return zlib.adler32(text.encode()) & 0x7FFFFFFF


def _until(condition: Callable[[], Any], problem: str) -> None:
    end = time.monotonic() + DEADLINE
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f'{problem} (waited {DEADLINE} s)')
        time.sleep(0.01)


def cpu_seconds(process: int) -> float:
    """Processor time that a process has used."""
    return time.clock_gettime((~process << 3) | 2)  # the clock of another process, as Linux numbers them


def block(
    variant: dict[str, Any], operator: Operator, server: Server, entries: Entries, samples: int
) -> dict[str, Any]:
    """One run of a variant: latencies in ms, and processor time at rest in % of a core."""
    server.seconds = low, high = variant['pause']
    to_transition, to_effect, lost = [], [], 0
    operator.start(variant['behavior'], variant['arguments'])
    entries.wait('Call', DEADLINE)
    for number in range(samples + 1):
        try:
            decided = entries.wait('Decide', RESULT_DEADLINE)
            result_sent = server.result_sent
        except TimeoutError:  # only the operator helps
            lost += 1
            operator.force('Call', 'done')
            decided = result_sent = entries.wait('Decide', DEADLINE)
        time.sleep(random.uniform(low, high))
        sent = time.monotonic_ns()
        operator.force('Decide', 'again')
        called = entries.wait('Call', DEADLINE)
        if number:  # the first one finds its way
            to_effect.append((called - sent) / 1e6)
            if decided != result_sent:
                to_transition.append((decided - result_sent) / 1e6)
    entries.wait('Decide', DEADLINE)
    time.sleep(SETTLE_SECONDS)
    used, began = cpu_seconds(variant['process']), time.monotonic()
    time.sleep(REST_SECONDS)
    at_rest = (cpu_seconds(variant['process']) - used) / (time.monotonic() - began) * 100
    operator.stop()
    return {'result to transition': to_transition, 'command to effect': to_effect, 'at rest': [at_rest], 'lost': lost}


def main() -> int:
    specification = json.loads(Path(sys.argv[1]).read_text())
    with NodeRuntime.open('flexbe_benchmark') as runtime, Entries() as entries:
        server = Server(runtime)
        operators: dict[str, Operator] = {'FlexBT': FlexbtOperator(runtime)}
        if specification['flexbe']:
            key, source = specification['flexbe']
            operators['FlexBE'] = FlexbeOperator(runtime, key, Path(source))
        blocks: dict[str, list[dict[str, Any]]] = {variant['name']: [] for variant in specification['variants']}
        for _ in range(specification['rounds']):
            for variant in specification['variants']:
                operator = operators[variant['engine']]
                try:
                    result = block(variant, operator, server, entries, specification['samples'])
                except (RuntimeError, TimeoutError) as error:
                    raise SystemExit(f'{variant["name"]}: {error}; {operator.told()}') from None
                blocks[variant['name']].append(result)
    Path(sys.argv[2]).write_text(json.dumps(blocks))
    return 0


if __name__ == '__main__':
    sys.exit(main())
