# SPDX-License-Identifier: BSD-3-Clause
"""What a document defines: trees of node definitions, which never change, and from which running trees are made."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

from .blackboard import Blackboard
from .errors import LoadError
from .example import Example
from .outcomes import Outcomes
from .ports import Port, PortDirection, PortValue, with_branch
from .source import Source
from .status import NodeKind


@dataclass(frozen=True, slots=True)
class NodeManifest:
    """What is known of a node type without an instance of it. ``children`` are least and greatest number of them.

    ``node_class`` is the class of its nodes, which the engine makes.
    """

    id: str
    kind: NodeKind
    node_class: type[Any]
    ports: Mapping[str, Port]
    children: tuple[int, int | None]
    description: str
    nav2_branch: str = ''
    """The branch of Nav2 (see ``NodeRegistry``) that alone has such nodes; '' if all have them."""

    @property
    def documentation(self) -> str:
        """The description, whose first paragraph tells the branch of Nav2 that alone has such nodes."""
        summary, *rest = self.description.split('\n\n')
        return '\n\n'.join((with_branch(summary, self.nav2_branch), *rest))

    @property
    def example(self) -> Example | None:
        """The example that just this class declares: one that derives from it has its own, or none."""
        example = vars(self.node_class).get('example')
        return example if isinstance(example, Example) else None

    @property
    def outcomes(self) -> Outcomes | None:
        """The rule that just this class declares: one that derives from it may do something else."""
        outcomes = vars(self.node_class).get('outcomes')
        return outcomes if isinstance(outcomes, Outcomes) else None


class RunnableScript(Protocol):
    """A script on the blackboard of a node."""

    @property
    def run(self) -> Callable[[], bool | None]:
        """Runs it, and gives the truth of a condition, otherwise None. Raises ScriptError."""


class Script(Protocol):
    """A script as a definition holds it: its text was found to be one."""

    @property
    def text(self) -> str: ...

    @property
    def empty(self) -> bool:
        """Whether it does nothing."""

    def bind(self, board: Blackboard, *, condition: bool = False) -> RunnableScript:
        """The script on ``board``; of a ``condition`` the truth is asked. Raises ScriptError when that is empty."""


class Scripts(Protocol):
    """Makes scripts of texts."""

    @property
    def enums(self) -> Mapping[str, int]:
        """The enum constants that scripts know."""

    def script(self, text: str) -> Script:
        """Raises ScriptError when the text is no script."""


NO_CONDITIONS: Final[Mapping[str, Script]] = {}


class NodeDefinition(NamedTuple):
    """One node of the XML. ``tree_id`` is set for sub-trees, whose ``values`` are the ports of the tree, as given.

    ``extra`` are the attributes that mean nothing to the engine (they begin with ``_``). ``offset`` is the place in
    the source, ``offsets`` those of the attributes. ``conditions`` are the pre- and post-conditions, by attribute.
    """

    manifest: NodeManifest
    name: str
    values: Mapping[str, PortValue]
    children: tuple[NodeDefinition, ...]
    offset: int
    offsets: Mapping[str, int]
    extra: Mapping[str, str]
    tree_id: str | None = None
    autoremap: bool = False
    conditions: Mapping[str, Script] = NO_CONDITIONS

    @property
    def label(self) -> str:
        """The node as an error names it."""
        id = self.tree_id or self.manifest.id
        return f'<{self.manifest.id} {self.name!r}>' if self.name != id or self.tree_id else f'<{id}>'


class TreeDefinition(NamedTuple):
    """One <BehaviorTree>."""

    id: str
    root: NodeDefinition
    source: Source
    offset: int

    def nodes(self) -> Iterator[NodeDefinition]:
        """All nodes, parents first, in document order."""
        stack = [self.root]
        while stack:
            node = stack.pop()
            yield node
            stack.extend(reversed(node.children))

    def error(self, node: NodeDefinition, message: str, attribute: str | None = None) -> LoadError:
        """An error at the place of the node, or of one of its attributes."""
        offset = node.offsets.get(attribute, node.offset) if attribute is not None else node.offset
        return self.source.error(offset, message, node.label)


class SubTreeModelPort(NamedTuple):
    """A port that a model (<TreeNodesModel>) declares for a tree. ``default`` None: it has to be given."""

    direction: PortDirection
    default: str | None


class TreeDocument(NamedTuple):
    """What one file defines. ``main`` is the tree to execute when none is named, if the file says so or has but one;
    ``names_main`` tells that the file says so.
    ``scripts`` are those of the registry with which it was read."""

    file: str
    trees: Mapping[str, TreeDefinition]
    main: str | None
    models: Mapping[str, Mapping[str, SubTreeModelPort]]
    warnings: tuple[LoadError, ...]
    scripts: Scripts
    names_main: bool
