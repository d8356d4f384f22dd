# SPDX-License-Identifier: BSD-3-Clause
"""The leaf that runs a behavior: a state machine of an executive, supervised by its operators, inside a tree."""

from __future__ import annotations

from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome
from flexbt_common.values.entries import Encoding
from flexbt_core.behavior_tree.model.errors import BlackboardError
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import KEYS, STRING, UNSIGNED, inout_port, input_port, output_port, separated
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.errors import FlexbtError
from flexbt_msgs import action
from flexbt_msgs.msg import BehaviorArgument
from flexbt_server.trees.blackboards import entries_of, read_values, write_all

from .action_leaf import ACTION_PORTS, ActionLeaf

HIGHEST_AUTONOMY: Final = 3


class ExecuteBehavior(ActionLeaf):
    """Runs a behavior on an executive until it ends. Halting the leaf stops the behavior.

    SUCCESS when the behavior ends with one of ``success_outcomes``, FAILURE with the reason otherwise.
    """

    __slots__ = ()

    action_type = action.ExecuteBehavior
    default_server = names.EXECUTE_BEHAVIOR
    cancels_on_pause = False  # the behavior would end
    goes_on = 'the behavior continues: pause it at its executive'
    ports = ACTION_PORTS | {
        'behavior': input_port(STRING, description='name of the behavior'),
        'arguments': input_port(STRING, default='', description='values of its parameters, as name=value;name=value'),
        'inputs': input_port(
            STRING, default='', literal=KEYS, description='blackboard keys that become input userdata, as key;key'
        ),
        'outputs': inout_port(
            STRING, default='', literal=KEYS, description='its output userdata that becomes blackboard keys, as key;key'
        ),
        'autonomy': input_port(UNSIGNED, default=str(HIGHEST_AUTONOMY), description='its level of autonomy, 0 to 3'),
        'success_outcomes': input_port(STRING, default='finished;done', description='its outcomes that are a SUCCESS'),
        'outcome': output_port(STRING, description='outcome of the behavior; empty when it did not end by one'),
    }
    example = Example('<ExecuteBehavior behavior="Inspect Site" inputs="site" outputs="report" outcome="{outcome}"/>')

    def make_goal(self) -> Any:
        autonomy = int(self.get_input('autonomy'))
        if autonomy > HIGHEST_AUTONOMY:
            raise ValueError(f'autonomy {autonomy} is none of 0 Off, 1 Low, 2 High, 3 Full')
        arguments = []
        for word in self._words('arguments'):
            name, equals, value = word.partition('=')
            if not equals:
                raise ValueError(f'port arguments: {word!r} is not name=value')
            arguments.append(BehaviorArgument(name=name.strip(), value=value.strip()))
        entries, missing, problems = entries_of(self.blackboard, self._words('inputs'), Encoding.BINARY)
        problems = [f'the blackboard has no value for {key!r}' for key in missing] + problems
        if problems:
            raise ValueError(f'port inputs: {"; ".join(problems)}')
        return self.action_type.Goal(
            behavior=str(self.get_input('behavior')),
            arguments=arguments,
            inputs=entries,
            autonomy=autonomy,
            output_encoding=action.BtExecute.Goal.BINARY,
        )

    def on_success(self, result: Any) -> NodeStatus:
        self.set_output('outcome', result.outcome)
        if result.outcome not in self._words('success_outcomes'):
            return self.fail(f'the behavior ended with {result.outcome!r}')
        received = {entry.key: entry for entry in result.outputs}
        wanted = self._words('outputs')
        missing = [key for key in wanted if key not in received]
        if missing:
            return self.fail(f'the behavior has no output {", ".join(map(repr, missing))}')
        try:
            write_all(self.blackboard, read_values(received[key] for key in wanted))
        except (BlackboardError, FlexbtError) as error:
            return self.fail(f'an output of the behavior does not fit: {error}')
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> None:
        self.set_output('outcome', '')

    def _words(self, port: str) -> list[str]:
        return separated(str(self.get_input(port)))
