# SPDX-License-Identifier: BSD-3-Clause
"""Script, ScriptCondition and Precondition: scripts as nodes of a tree."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import DecoratorNode
from flexbt_core.behavior_tree.model.definition import RunnableScript
from flexbt_core.behavior_tree.model.errors import ScriptError
from flexbt_core.behavior_tree.model.outcomes import Example, OneOf
from flexbt_core.behavior_tree.model.ports import NODE_STATUS, STRING, input_port
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, SKIPPED, SUCCESS, NodeKind, NodeStatus
from flexbt_core.behavior_tree.script.interpreter import CONDITION, SCRIPT


class _PointedScript:
    """A script whose text is on the blackboard. It must exist when the tree is made, and may change later."""

    __slots__ = ('_bound', '_condition', '_node', '_port', '_text')

    def __init__(self, node: TreeNode, port: str, condition: bool) -> None:
        """Raise PortError if the text is missing, and ScriptError if it is not a script."""
        self._node = node
        self._port = port
        self._condition = condition
        self._text: str | None = None
        self._read()

    def _read(self) -> None:
        node = self._node
        text: str = node.get_input(self._port)
        if text != self._text:
            self._bound = node.context.scripts.script(text).bind(node.blackboard, condition=self._condition)
            self._text = text

    def run(self) -> bool | None:
        self._read()
        return self._bound.run()


def _script_of(node: TreeNode, config: NodeConfig, port: str) -> RunnableScript:
    """Return the script of a port, whose literals are of type SCRIPT or CONDITION."""
    given = config.values[port]
    condition = node.ports[port].literal is CONDITION
    if given.key is not None:
        return _PointedScript(node, port, condition)
    bound: RunnableScript = given.literal.bind(config.blackboard, condition=condition)
    return bound


class Script(LeafNode):
    """Runs the script ``code`` and returns SUCCESS. A script that fails is an error."""

    __slots__ = ('_script',)

    kind = NodeKind.ACTION
    ports = {'code': input_port(STRING, literal=SCRIPT, description='the script')}
    outcomes = OneOf((SUCCESS,))
    example = Example(
        """
        <Script code="speed := 0.2; label := speed > 0.1 ? 'fast' : 'slow'"/>
        """,
        ticks=(SUCCESS,),
        after={'speed': 0.2, 'label': 'fast'},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._script = _script_of(self, config, 'code')

    def execute(self) -> NodeStatus:
        try:
            self._script.run()
        except ScriptError as error:
            raise self.fault(error) from error
        self.status = SUCCESS
        return SUCCESS


class ScriptCondition(LeafNode):
    """SUCCESS when the last statement of the script ``code`` is true, FAILURE if not."""

    __slots__ = ('_script',)

    kind = NodeKind.CONDITION
    # A script may also be in an entry of numbers or truth values, which this port does not make one of text.
    ports = {'code': replace(input_port(STRING, literal=CONDITION, description='the script'), declares=False)}
    example = Example(
        '<ScriptCondition code="battery &lt; 20 || tired"/>',
        ticks=(SUCCESS,),
        before={'battery': 50, 'tired': True},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._script = _script_of(self, config, 'code')

    def execute(self) -> NodeStatus:
        try:
            status = SUCCESS if self._script.run() else FAILURE
        except ScriptError as error:
            raise self.fault(error) from error
        self.status = status
        return status

    def failure_reason(self) -> str:
        return f'{self.id}: [{self.port_text("code")}] does not hold'


class Precondition(DecoratorNode):
    """Ticks the child if the script ``if`` is true; otherwise returns ``else``.

    The node does not evaluate the script again before the child has completed. As in BehaviorTree.CPP, this also holds
    after the child is skipped or halted: the next run then begins without evaluating the script. To evaluate it at
    each start, use ``_skipIf`` or ``_failureIf`` of the child.
    """

    __slots__ = ('_blocked', '_holds', '_script')

    running_at_completion = False
    ports = {
        'if': input_port(STRING, literal=CONDITION, description='the script'),
        'else': input_port(NODE_STATUS, default='FAILURE', description='result when the script is false'),
    }
    example = Example(
        '<Precondition if="battery > 20" else="FAILURE"><AlwaysSuccess/></Precondition>',
        ticks=(FAILURE,),
        before={'battery': 10},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._script = _script_of(self, config, 'if')
        self._holds = False
        self._blocked = False

    def execute(self) -> NodeStatus:
        otherwise: NodeStatus = self.get_input('else')
        if not self._holds:
            try:
                self._holds = bool(self._script.run())
            except ScriptError as error:
                raise self.fault(error) from error
        self._blocked = not self._holds
        if self._blocked:
            status = self.checked(otherwise)
        else:
            status = self._tick()
            if status is SUCCESS or status is FAILURE:
                self._holds = False
                self.child.status = IDLE
        if status is not SKIPPED:
            self.status = status
        return status

    def failure_cause(self) -> TreeNode | None:
        return None if self._blocked else self.child

    def failure_reason(self) -> str:
        return f'{self.id}: [{self.port_text("if")}] does not hold' if self._blocked else super().failure_reason()


NODES: Final = (
    Script,
    ScriptCondition,
    Precondition,
)
