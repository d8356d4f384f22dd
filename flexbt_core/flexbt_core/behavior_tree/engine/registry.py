# SPDX-License-Identifier: BSD-3-Clause
"""The registry of node classes that XML may name, and the skills of their leaves."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

from flexbt_core.behavior_tree.model.blackboard_json import JsonTypes
from flexbt_core.behavior_tree.model.definition import NodeManifest, model_name_problem, port_name_problem
from flexbt_core.behavior_tree.model.errors import ConversionError, RegistrationError
from flexbt_core.behavior_tree.model.outcomes import OneOf
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, is_fixed, pointer_key
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SUCCESS, NodeKind
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.skill import Outcome, OutcomeClass, Skill
from flexbt_core.values.text import short_repr, similar_names

from .leaf import Condition, LeafNode, SyncAction
from .node import TreeNode
from .parents import ControlNode, DecoratorNode

Elements = Iterable[tuple[str, Mapping[str, str]]]
"""The elements of a file, each as its ID (or tag if it is not a node) and attributes."""


class NodeRegistry:
    """Node types by the ID that XML uses. Each host creates one, see ``builtin_registry``.

    A file may be written for a branch of Nav2 in which some IDs mean other node types. ``nav2_branch_of`` returns that
    branch for the elements of the file; for None and for an unknown branch, IDs mean the types as they are registered.
    """

    def __init__(self, scripts: ScriptLibrary | None = None) -> None:
        """Create an empty registry; ``scripts`` has the enum constants for scripts."""
        self._manifests: dict[str, NodeManifest] = {}
        self.nav2_branches: dict[str, dict[str, NodeManifest]] = {}
        """Node types that differ from the registered ones in a branch, by branch and ID."""
        self.nav2_branch_of: Callable[[Elements], str | None] = lambda elements: None
        self.on_clash: Callable[[str, RegistrationError], None] | None = None
        """Callback for an ID in use, which keeps its type; without a callback, ``register`` raises the error."""
        self.scripts = scripts if scripts is not None else ScriptLibrary()
        self.json_types = JsonTypes()
        """Classes whose objects the JSON of a blackboard can contain."""

    def register(self, id: str, node_class: type[TreeNode]) -> NodeManifest:
        """Register ``node_class`` as ``id``.

        Raises RegistrationError if the ID is in use (but see ``on_clash``) or not allowed, if a port declaration is
        invalid, or if the class is abstract.
        """
        return self._register(id, node_class, self._manifests)

    def _register(
        self, id: str, node_class: type[TreeNode], manifests: dict[str, NodeManifest], only: str = ''
    ) -> NodeManifest:
        if id in manifests:
            taken = manifests[id].node_class
            error = RegistrationError(
                f'node ID [{id}] is registered already, for {taken.__module__}.{taken.__qualname__}; choose another ID'
            )
            if self.on_clash is None:
                raise error
            self.on_clash(id, error)
            return manifests[id]
        problem = model_name_problem(id)
        if problem:
            raise RegistrationError(f'node ID [{id}]: {problem}')
        if not (inspect.isclass(node_class) and issubclass(node_class, LeafNode | DecoratorNode | ControlNode)):
            raise RegistrationError(
                f'node ID [{id}]: {node_class!r} is not a node class; derive it from SyncAction, StatefulAction, '
                'Condition, Decorator or Control'
            )
        if inspect.isabstract(node_class):
            missing = ', '.join(sorted(node_class.__abstractmethods__))
            raise RegistrationError(f'node ID [{id}]: {node_class.__qualname__} does not implement {missing}')
        if not isinstance(getattr(node_class, 'kind', None), NodeKind):
            raise RegistrationError(
                f'node ID [{id}]: {node_class.__qualname__} has no kind; derive it from SyncAction, StatefulAction or '
                'Condition, or write kind = NodeKind.ACTION'
            )
        if not isinstance(node_class.ports, Mapping):
            raise RegistrationError(
                f'node ID [{id}]: ports of {node_class.__qualname__} has to be an attribute of the class that has the '
                f"ports by their names, ports = {{'name': input_port(STRING)}}, not {short_repr(node_class.ports)}"
            )
        for name, port in node_class.ports.items():
            problem = _port_problem(name, port)
            if problem:
                raise RegistrationError(f'node ID [{id}], port [{name}]: {problem}')
        for name in node_class.begins_without if issubclass(node_class, LeafNode) else ():
            if name not in node_class.ports or node_class.ports[name].type is None:
                raise RegistrationError(
                    f'node ID [{id}]: begins_without names {short_repr(name)}, which has to be a port with a type: the '
                    'empty value is that of the type'
                )
        problem = _skill_problem(node_class)
        if problem:
            raise RegistrationError(f'node ID [{id}], skill: {problem}')
        manifest = NodeManifest(
            id,
            node_class.kind,
            node_class,
            dict(node_class.ports),
            _children_bounds(node_class),
            inspect.cleandoc(vars(node_class).get('__doc__') or ''),
            only,
        )
        manifests[id] = manifest
        return manifest

    def register_classes(self, node_classes: Iterable[type[TreeNode]]) -> None:
        """Register classes under the names that they declare. Raises RegistrationError, as :meth:`register` does."""
        for node_class in node_classes:
            self.register_class(node_class)

    def register_class(self, node_class: type[TreeNode], nav2_branch: str = '', *, only: str = '') -> None:
        """Register a class under the name that it declares, or only for files of ``nav2_branch`` if it is set. ``only``
        is the single branch of Nav2 that has such nodes. Raises RegistrationError, as :meth:`register` does.
        """
        manifests = self.nav2_branches.setdefault(nav2_branch, {}) if nav2_branch else self._manifests
        self._register(declared_id(node_class), node_class, manifests, only)

    def types_for(self, elements: Elements) -> NodeRegistry | BranchTypes:
        """Return the node types for a file with these elements."""
        others = self.nav2_branches.get(self.nav2_branch_of(elements) or '')
        return self if others is None else BranchTypes(self, others)

    def get(self, id: str) -> NodeManifest | None:
        return self._manifests.get(id)

    def suggestions(self, id: str) -> list[str]:
        """Return registered IDs for which ``id`` may be a slip, best first.

        An ID that only shares a word with others, as MoveToPose with NavigateToPose, is one of a package that is not
        here.
        """
        return similar_names(id, self._manifests, most=3, cutoff=0.8)

    def __contains__(self, id: str) -> bool:
        return id in self._manifests

    def __iter__(self) -> Iterator[NodeManifest]:
        return iter(self._manifests.values())

    def __len__(self) -> int:
        return len(self._manifests)


class BranchTypes:
    """The node types of a registry, some of them replaced by those of a branch of Nav2."""

    def __init__(self, registry: NodeRegistry, others: Mapping[str, NodeManifest]) -> None:
        self._registry = registry
        self._others = others

    @property
    def scripts(self) -> ScriptLibrary:
        return self._registry.scripts

    def get(self, id: str) -> NodeManifest | None:
        return self._others.get(id) or self._registry.get(id)

    def suggestions(self, id: str) -> list[str]:
        return self._registry.suggestions(id)

    def __contains__(self, id: str) -> bool:
        return id in self._registry


def declared_id(node_class: type[TreeNode]) -> str:
    """Return the ID that a class declares: its name, unless it has its own ``xml_name``."""
    id: str = vars(node_class).get('xml_name', node_class.__name__)
    return id


def _children_bounds(node_class: type[TreeNode]) -> tuple[int, int | None]:
    if issubclass(node_class, ControlNode):
        return node_class.children_bounds
    if node_class.kind is NodeKind.SUBTREE:
        return 0, 0
    return (1, 1) if issubclass(node_class, DecoratorNode) else (0, 0)


def _skill_problem(node_class: type[TreeNode]) -> str:
    """Return what is wrong with the declared skill of a leaf; '' if it is valid on its own."""
    if not issubclass(node_class, LeafNode) or not isinstance(node_class.skill, Skill):
        return ''  # a user's class may use the attribute for something else
    for name in node_class.skill.outcomes:
        if name not in ('SUCCESS', 'FAILURE'):
            return f'{short_repr(name)} is not an outcome of a leaf; it ends by SUCCESS or FAILURE'
    return next((f'{" ".join(at)}: {problem}' for at, problem in node_class.skill.problems()), '')


def _port_problem(name: str, port: object) -> str:
    problem = port_name_problem(name)
    if problem:
        return problem
    if not isinstance(port, Port):
        return f'{port!r} is not a Port; use input_port, output_port or inout_port'
    if port.default is NO_DEFAULT:
        return ''
    pointer = isinstance(port.default, str) and pointer_key(port.default, name) is not None
    if not port.readable and not pointer:
        return f"the default of an output has to be a pointer, as in {{key}}, not '{port.default}'"
    kind = port.type
    if isinstance(port.default, str) and not pointer and is_fixed(kind) and kind.from_text is not None:
        try:
            kind.parse(port.default)
        except ConversionError as error:
            return f'the default does not fit the type: {error}'
    return ''


# The skills of leaves: declarations of their classes, completed from ports and outcomes.


def node_skill(manifest: NodeManifest) -> Skill | None:
    """Return the skill of a node type; None if it is not a leaf.

    A leaf reads and writes its ports, and ends with SUCCESS or FAILURE; a condition answers with them. A derived leaf
    inherits the skill, unless it declares another.
    """
    node_class = manifest.node_class
    if not issubclass(node_class, LeafNode):
        return None
    rule = manifest.outcomes
    possible = rule.results if isinstance(rule, OneOf) else (SUCCESS, FAILURE, RUNNING)
    if manifest.kind is NodeKind.CONDITION:
        classes = {SUCCESS: OutcomeClass.ANSWERED, FAILURE: OutcomeClass.ANSWERED}
    else:
        classes = {SUCCESS: OutcomeClass.COMPLETED, FAILURE: OutcomeClass.FAILED}
    declared: object = node_class.skill
    skill = (declared if isinstance(declared, Skill) else Skill()).completed_by(
        manifest.id,
        {status.name: Outcome(kind) for status, kind in classes.items() if status in possible},
        reads=[name for name, port in manifest.ports.items() if port.readable],
        writes=[name for name, port in manifest.ports.items() if port.writable],
    )
    is_at_once = issubclass(node_class, SyncAction | Condition) or RUNNING not in possible
    return replace(skill.lasting(0.0, 0.0) if is_at_once else skill, knows_ports=True)


def node_skills(registry: NodeRegistry, broken: Callable[[str], None]) -> SkillLibrary:
    """Return the skills of all leaves of a registry.

    Reports invalid declarations of a class to ``broken``, with file and line of the class, and then keeps only the
    resources and the meanings of the outcomes of its skill, so that one faulty package does not affect others.
    """
    manifests = {manifest.id: manifest for manifest in registry}
    skills = {id: skill for id, manifest in manifests.items() if (skill := node_skill(manifest)) is not None}
    while True:
        library, problems = SkillLibrary.joined(skills.values())
        if not problems:
            return library
        for at, text in problems:
            section, name, *inside = at
            ids = [name] if section == 'skills' else [id for id, one in skills.items() if _declares(one, name)]
            for id in ids:
                where = ' '.join(inside) if section == 'skills' else f'predicate {name}'
                broken(f'{_place(manifests[id])}: skill of {id}: {where + ": " if where else ""}{text}')
                skills[id] = _without_literals(skills[id])


def _declares(skill: Skill, predicate: str) -> bool:
    return any(one.name == predicate for one in skill.predicates)


def _without_literals(skill: Skill) -> Skill:
    outcomes = {name: replace(one, effects=()) for name, one in skill.outcomes.items()}
    return replace(skill, parameters={}, preconditions=(), outcomes=outcomes, arguments={}, predicates=())


def _place(manifest: NodeManifest) -> str:
    """Return file and line of the class of a node type."""
    node_class = manifest.node_class
    try:
        return f'{inspect.getsourcefile(node_class)}:{inspect.getsourcelines(node_class)[1]}'
    except (OSError, TypeError):  # a class without source file
        return f'{node_class.__module__}.{node_class.__qualname__}'
