# SPDX-License-Identifier: BSD-3-Clause
"""Node types that a YAML file declares: a call of an action or a service, or a topic, with custom name and ports.

::

    nodes:
      DockAt:
        action: nav2_msgs/action/DockRobot     # or service, publish, read, check: the type
        name: dock_robot                       # of the action, service or topic
        description: Docks the robot at a station.
        fields:
          goal.use_dock_id: true
          goal.dock_id: '{station}'            # an input port, of the type of the field
          goal.max_staging_time: '${patience * 2}'
          result.num_retries: '{retries}'      # an output port
        ports:                                 # further properties of ports
          station: {description: name of the station}
          patience: {type: float64, default: 30.0}
        success: result.success
        skill: {resources: [base]}             # as in a file of skills

A package lists its files in the ament index, in resource ``flexbt_nodes``: paths relative to its share, one per line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import yaml
from ament_index_python.packages import get_package_share_directory
from ament_index_python.resources import get_resource, get_resources

from flexbt_common.errors import UnknownTypeError
from flexbt_common.values.fields import Field
from flexbt_common.values.templates import Expression, Source, embedded, is_expression
from flexbt_common.values.value_types import FieldError, interface_class, slot_value
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import port_name_problem
from flexbt_core.behavior_tree.model.errors import ConversionError, ElementError, RegistrationError, ScriptError
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, input_port, pointer_key
from flexbt_core.errors import FlexbtError
from flexbt_core.skills.literals import SkillError
from flexbt_core.skills.yaml_files import read_skills
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.yaml_data import YamlParts

from .leaves.call_leaves import CallAction, CallService, CheckTopic, Publish, ReadTopic
from .leaves.message_ports import Fields, MessageLeaf, expression_type, type_by_name, type_of_field

RESOURCE: Final = 'flexbt_nodes'
"""Type of the ament resource by which a package lists its manifests."""
MOST_BYTES: Final = 1_000_000
"""Maximum size of a manifest, bytes."""
KINDS: Final[Mapping[str, tuple[type[MessageLeaf], str]]] = {
    'action': (CallAction, 'server_name'),
    'service': (CallService, 'service_name'),
    'publish': (Publish, 'topic_name'),
    'read': (ReadTopic, 'topic_name'),
    'check': (CheckTopic, 'topic_name'),
}
"""Classes by the key for the interface type, with the port for the name of the server or topic."""
FIXED: Final = ('type', 'success', 'check', 'resources', 'on_pause', 'qos')
"""Ports of these classes that a node from a manifest lacks: the manifest determines their values."""
_OF_SKILLS: Final = ('types', 'predicates')
"""Sections that the skills of a manifest refer to, as in a file of skills."""


class ManifestError(FlexbtError):
    """A manifest cannot be used; ``problems`` lists all errors, as ``file:line: what``."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__('\n'.join(problems))
        self.problems = tuple(problems)


def read_manifest(text: str, source: str) -> dict[str, type[MessageLeaf]]:
    """Return the node types that a manifest declares, by ID.

    Raises:
        ManifestError: a declaration is wrong, or an interface is not installed.
    """
    reader = _Reader(source)
    nodes = reader.nodes(text)
    if reader.problems:
        raise ManifestError(reader.problems)
    return nodes


def register_manifests(registry: NodeRegistry, on_broken: Callable[[str, Exception], None]) -> None:
    """Register the node types of all manifests of installed packages, in the order of the packages."""
    for package in sorted(get_resources(RESOURCE)):
        try:
            files = manifests_of(package)
        except (OSError, LookupError, ValueError) as error:  # for example what is left of a package
            on_broken(f'the nodes of the package {package}', error)
            continue
        for file in files:
            try:
                if file.stat().st_size > MOST_BYTES:
                    raise ManifestError([f'{file}: it has more than {MOST_BYTES} bytes'])
                nodes = read_manifest(file.read_text(encoding='utf-8'), str(file))
            except (OSError, ValueError, ManifestError) as error:
                on_broken(f'the nodes of {file}', error)
                continue
            for id, node in nodes.items():
                try:
                    registry.register(id, node)
                except RegistrationError as error:
                    on_broken(f'the node type [{id}] of {file}', error)


def manifests_of(package: str) -> list[Path]:
    """Return the manifests that a package lists. Raises OSError, LookupError or ValueError if they are not found."""
    content, _ = get_resource(RESOURCE, package)
    return [Path(get_package_share_directory(package)) / line for line in content.split()]


class _Reader(YamlParts):
    """A reader of a manifest."""

    def __init__(self, source: str) -> None:
        super().__init__(source)
        self._of_skills: dict[str, Any] = {}

    def nodes(self, text: str) -> dict[str, type[MessageLeaf]]:
        entries = self.mapping(self.root(text), 'the manifest')
        self.refuse_others(entries, ('nodes', *_OF_SKILLS), 'a manifest')
        self._of_skills = {name: self.value(entries[name], name) for name in _OF_SKILLS if name in entries}
        nodes = {}
        for id, node in self.mapping(entries.get('nodes'), 'nodes').items():
            made = self._node(id, node)
            if made is not None:
                nodes[id] = made
        return nodes

    def _node(self, id: str, node: yaml.Node) -> type[MessageLeaf] | None:
        entries = self.mapping(node, f'node {id}')
        kinds = [kind for kind in KINDS if kind in entries]
        if len(kinds) != 1:
            self.problem(node, f'node {id} needs one of {", ".join(KINDS)}, with the type; it has {kinds or "none"}')
            return None
        (kind,) = kinds
        base, name_port = KINDS[kind]
        options = [port for port in base.ports if port not in ('type', name_port)]
        known = (kind, 'name', 'description', 'fields', 'ports', 'skill', *options)
        self.refuse_others(entries, known, f'node {id}')
        try:
            interface = interface_class(self.name(entries[kind], kind), base.interface_kind)
        except UnknownTypeError as error:
            self.problem(entries[kind], f'node {id}: {error}')
            return None
        before = len(self.problems)
        fields, ports = self._fields(id, base, interface, entries)
        attributes: dict[str, Any] = {'is_declared': True}
        condition = entries.get(base.condition) if base.condition else None
        if condition is not None:
            attributes['verdict'] = self._condition(id, condition, base, interface)
        elif kind == 'check':
            self.problem(node, f'node {id} needs check, the condition')
        try:
            given: dict[str, str] = {
                key: self.name(entries[key], key) for key in ('on_pause', 'qos', 'resources') if key in entries
            }
            attributes |= base.options(given)
        except ElementError as error:
            self.problem(node, f'node {id}: {error}')
        ports |= {port: declared for port, declared in base.ports.items() if port not in FIXED}
        for port in options:
            if port in entries and port not in FIXED:
                ports[port] = replace(ports[port], default=self.name(entries[port], port), required=False)
        if 'name' in entries:
            default = self.name(entries['name'], 'name')
            ports[name_port] = replace(ports[name_port], default=default, required=False)
        self._skill(id, entries, base, attributes)
        if len(self.problems) > before:
            return None
        description = self.name(entries['description'], 'description') if 'description' in entries else ''
        attributes['__doc__'] = description or f'Calls {interface.__name__}.'
        return base.derived(id, interface, fields, ports, attributes)

    def _condition(self, id: str, node: yaml.Node, base: type[MessageLeaf], interface: type[Any]) -> Expression | None:
        try:
            return expression_type('condition', base.received(interface)).parse(self.name(node, base.condition))
        except ConversionError as error:
            self.problem(node, f'node {id}: {base.condition}: {error}')
            return None

    def _skill(
        self, id: str, entries: Mapping[str, yaml.Node], base: type[MessageLeaf], attributes: dict[str, Any]
    ) -> None:
        node = entries.get('skill')
        if node is None:
            return
        declared = self._of_skills | {'skills': {id: self.value(node, f'skill of {id}')}}
        try:
            library = read_skills(yaml.safe_dump(declared), f'{self.source}: node {id}')
        except (SkillError, ValueError) as error:
            self.problem(node, str(error))
            return
        skill = library.skills[id]
        attributes['skill'] = replace(
            skill,
            name='',
            resources=(*skill.resources, *attributes.get('skill', base.skill).resources),
            ignores_cancel=skill.ignores_cancel or base.skill.ignores_cancel,
            predicates=tuple(library.predicates.values()),
        )

    # -- fields and ports --------------------------------------------------------------------------------------------

    def _fields(
        self, id: str, base: type[MessageLeaf], interface: type[Any], entries: Mapping[str, yaml.Node]
    ) -> tuple[Fields, dict[str, Port]]:
        fields: Fields = {}
        ports: dict[str, Port] = {}
        known = self.mapping(entries.get('ports'), f'ports of {id}')
        for path, node in self.mapping(entries.get('fields'), f'fields of {id}').items():
            prefix, _, inner = path.partition('.')
            if prefix not in base.parts:
                near = did_you_mean(prefix, base.parts, '')
                self.problem(node, f'node {id}: [{path}] begins with none of {", ".join(base.parts)}{near}')
                continue
            try:
                field = base.field(interface, path)
                source = self._source(path, node, field, is_input=base.parts[prefix].is_input)
            except (FieldError, ConversionError, ScriptError) as error:
                self.problem(node, f'node {id}: [{path}]: {error}')
                continue
            fields[prefix, inner] = field, source
            if source.name:
                if source.name in base.ports and source.name not in FIXED:
                    self.problem(node, f'node {id}: it has a port {source.name} anyway; use another name for [{path}]')
                self._add_port(id, node, source.name, base.port_of(path, field), ports)
        for name, node in known.items():
            self._describe(id, name, node, ports)
        return fields, ports

    def _source(self, path: str, node: yaml.Node, field: Field, *, is_input: bool) -> Source:
        value = self.value(node, path)
        port = pointer_key(value, path) if isinstance(value, str) else None
        if port is not None:
            return Source(port)
        if not is_input:
            raise ConversionError(f'an output needs a port, as in {{name}}, not {short_repr(value)}')
        if is_expression(value):
            return Source('', embedded(value))
        kind = type_of_field(field)
        if isinstance(value, str) and kind.from_text is not None:
            return Source('', kind.parse(value))  # for example the name of a constant
        return Source('', value if field.slot is None else slot_value(value, field.slot, path))

    def _add_port(self, id: str, node: yaml.Node, name: str, port: Port, ports: dict[str, Port]) -> None:
        problem = port_name_problem(name)
        if problem:
            self.problem(node, f'node {id}: {problem}')
        other = ports.get(name)
        if other is not None and (other.type, other.direction) != (port.type, port.direction):
            if other.type is None or port.type is None or not other.type.same(port.type):
                self.problem(node, f'node {id}: the port {name} has two types, {other.type} and {port.type}')
            elif other.direction is not port.direction:
                self.problem(node, f'node {id}: the port {name} is an input and an output; use two names')
        ports.setdefault(name, port)

    def _describe(self, id: str, name: str, node: yaml.Node, ports: dict[str, Port]) -> None:
        """Complete a port from its entry in the manifest, or declare it if only expressions use it."""
        facts = self.mapping(node, f'port {name} of {id}')
        self.refuse_others(facts, ('type', 'default', 'description', 'optional'), f'port {name} of {id}')
        port = ports.get(name)
        if 'type' in facts:
            if port is not None:
                self.problem(node, f'node {id}: the port {name} has the type of its field; remove its type')
            try:
                port = input_port(type_by_name(self.name(facts['type'], 'type')))
            except UnknownTypeError as error:
                self.problem(node, f'node {id}, port {name}: {error}')
                return
        if port is None:
            near = did_you_mean(name, ports, '; a port that only expressions use needs a type')
            self.problem(node, f'node {id}: no field has the port {name}{near}')
            return
        default: Any = NO_DEFAULT
        if 'default' in facts:
            default = self.value(facts['default'], 'default')
            default = str(default).lower() if isinstance(default, bool) else default
            default = str(default) if isinstance(default, int | float) else default
        is_optional = 'optional' in facts and self.truth(facts['optional'], f'optional of the port {name} of {id}')
        required = port.readable and default is NO_DEFAULT and not is_optional
        description = self.name(facts['description'], 'description') if 'description' in facts else ''
        ports[name] = replace(port, default=default, description=description, required=required)
