# SPDX-License-Identifier: BSD-3-Clause
"""The ROS graph of a world: contexts, nodes, names, and what all entities of rclpy have in common.

The classes here and in the modules beside it stand in for those of the same names in ``rclpy._rclpy_pybind11``, and
keep their methods and errors. What has no side effect (names, QoS profiles, enumerations, serialization) is done by the
real module, :data:`REAL`.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import itertools
import math
import os
import re
import sys
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple

from .scheduler import SCHEDULER, Process, Task

MODULE: Final = 'rclpy._rclpy_pybind11'
GID_BYTES: Final = 12


def _load() -> ModuleType:
    found = importlib.util.find_spec('rclpy')
    if found is None or found.origin is None:
        raise ImportError('rclpy is not installed')
    for suffix in importlib.machinery.EXTENSION_SUFFIXES:
        file = Path(found.origin).with_name(f'_rclpy_pybind11{suffix}')
        if file.exists():
            loader = importlib.machinery.ExtensionFileLoader(MODULE, str(file))
            spec = importlib.util.spec_from_file_location(MODULE, file, loader=loader)
            assert spec is not None
            module = importlib.util.module_from_spec(spec)
            loader.exec_module(module)
            return module
    raise ImportError(f'{found.origin} has no compiled module _rclpy_pybind11')


REAL: Final = _load()
"""The compiled module of the installed rclpy."""

InvalidHandle: Final = REAL.InvalidHandle
RCLError: Final = REAL.RCLError


class Domain:
    """The domain of a world: its topics, services and nodes, and its network."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        for logger, level in getattr(self, 'levels', {}).items():
            REAL.rclpy_logging_set_logger_level(logger, level)
        self.levels: dict[str, int] = {}
        """The levels of loggers before a program has set others."""
        self.parents: dict[tuple[Process, str], str] = {}
        """The logger of a node by process and name of a child of it."""
        self.topics: dict[tuple[str, str], Any] = {}  # by domain and name
        self.services: dict[tuple[str, str], Any] = {}
        self.nodes: list[Node] = []
        self.numbers = itertools.count(1)
        self.network: Callable[[Process, Process, bool], int | None] | None = None
        """Delay of a message from one process to another, ns, given whether it is reliable; None if it is lost."""
        self.discovery: Callable[[Process, Process], int] | None = None
        """Time until endpoints of two processes have found each other, ns."""
        self.on_message: Callable[[Process, str, Any], object] | None = None
        """Observer of all published messages: process, topic, and the :class:`~.topics.Sample`."""
        self.log: list[tuple[int, Process, int, str, str]] = []
        """Lines of the log: time (ns), process, severity, logger, text."""

    def vanish(self, is_meant: Callable[[Any], bool]) -> None:
        """Remove nodes and endpoints whose process is gone, or that nobody can use any more."""
        ends = [end for topic in self.topics.values() for end in (*topic.publishers, *topic.subscriptions)]
        ends += [end for service in self.services.values() for end in (*service.servers, *service.clients)]
        for end in (*ends, *self.nodes):
            if is_meant(end):
                end.is_ended = True
                end._destroy()

    def transfer(
        self,
        source: Process,
        target: Process,
        is_reliable: bool,
        last: dict[Any, int],
        key: Any,
        arrive: Callable[[], None],
    ) -> None:
        """Call ``arrive`` when a message has passed the network, in the order of sending; ``last`` has these times."""
        if self.network is None or source is target:
            arrive()
            return
        delay = self.network(source, target, is_reliable)
        if delay is not None:
            last[key] = max(SCHEDULER.now + delay, last.get(key, 0))
            SCHEDULER.call_at(last[key], arrive)


DOMAIN: Final = Domain()
_pointers: Final = itertools.count(1000)
_GOALS: Final = '/_action/send_goal'


class Destroyable:
    """A handle that lives as long as it is used: as in rclpy, a ``with`` block uses it."""

    _uses = 0
    is_ended = False
    """True if its destruction was requested."""

    def __init__(self) -> None:
        self.pointer = next(_pointers)

    def __enter__(self) -> Any:
        if self.is_ended:
            raise InvalidHandle('cannot use Destroyable because destruction was requested')
        self._uses += 1
        return self

    def __exit__(self, *_: object) -> None:
        self._uses -= 1
        if self.is_ended and not self._uses:
            self._destroy()

    def destroy_when_not_in_use(self) -> None:
        """Destroy it once its last use has ended; a second call has no effect."""
        if self.is_ended:
            return
        self.is_ended = True
        if not self._uses:
            self._destroy()

    def _destroy(self) -> None:
        """Remove it from the graph."""


class Entity(Destroyable):
    """What an executor waits for."""

    waiter: Task | None = None
    """Task that waits for it in a wait set."""
    watcher: Any = None
    """Executor that is told when it becomes ready (:class:`~.product.ReadyEntities`)."""

    def is_ready(self) -> bool:
        raise NotImplementedError

    def notify(self) -> None:
        """Wake who waits for it."""
        if self.watcher is not None:
            self.watcher.notify(self)
        if self.waiter is not None:
            SCHEDULER.wake(self.waiter, True)


class _Rule(NamedTuple):
    """A rule that renames: for which node, '' for all; topics or services, '' for both, or a node; what; and how."""

    node: str
    kind: str
    name: str
    value: str


_RULE: Final = re.compile(r'(?:([^:]*):(?!//|=))?(?:ros(topic|service)://)?(.*?):=(.*)')


class _Rules:
    """The ROS arguments of a process or node: renaming rules; parameters in their order, a file as ``('', path)``."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self.renaming: list[_Rule] = []
        self.parameters: list[tuple[str, str]] = []
        self.has_rosout = '--disable-rosout-logs' not in arguments
        words = iter(arguments)
        is_for_ros = False
        for word in words:
            if word == '--ros-args':
                is_for_ros = True
            elif word == '--':
                is_for_ros = False
            elif is_for_ros and word in ('-r', '--remap'):
                self._rename(next(words, ''))
            elif is_for_ros and word in ('-p', '--param'):
                name, _, value = next(words, '').partition(':=')
                self.parameters.append((name, value))
            elif is_for_ros and word == '--params-file':
                self.parameters.append(('', next(words, '')))
            elif is_for_ros and word in ('--log-level', '--log-config-file', '-e', '--enclave', '--log-file-name'):
                next(words, '')
            elif not is_for_ros and not REAL.rclpy_remove_ros_args([word]):  # a rule in the form of ROS 2 Dashing
                self._rename(word)

    def _rename(self, rule: str) -> None:
        if found := _RULE.fullmatch(rule):
            self.renaming.append(_Rule(*found.groups('')))


def _renamed(renaming: Sequence[_Rule], node: str, *rules: str) -> str | None:
    """Return what the first of these rules that is meant for a node gives; None without one."""
    return next((rule.value for rule in renaming if rule.name in rules and rule.node in ('', node)), None)


class Context(Destroyable):
    """Stand-in for rcl's context: a participant of the domain."""

    def __init__(self, args: Sequence[str], domain_id: int = 0) -> None:
        super().__init__()
        self.process = SCHEDULER.current.process
        if args is sys.argv:
            args = self.process.arguments or args
        try:
            REAL.rclpy_remove_ros_args(args)
        except REAL.RCLInvalidROSArgsError as error:
            raise RCLError(f'failed to initialize rcl: {str(error).partition(": ")[2]}') from None
        self.rules = _Rules(args)
        self.process.contexts.append(self)
        self.nodes: list[Node] = []
        is_default = domain_id == REAL.RCL_DEFAULT_DOMAIN_ID
        self._domain = int(os.environ.get('ROS_DOMAIN_ID') or 0) if is_default else domain_id
        is_alone = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') == 'OFF'
        self.domain = f'{self._domain} alone {self.pointer}' if is_alone else str(self._domain)
        """What its endpoints can find: others of the same domain, or only each other."""
        self._is_ok = True
        self._prefix = next(DOMAIN.numbers).to_bytes(GID_BYTES, 'big')
        self._numbers = itertools.count(1)

    def ok(self) -> bool:
        return self._is_ok

    def shutdown(self) -> None:
        if not self._is_ok:
            raise RCLError('failed to shutdown: rcl_shutdown already called on the given context')
        self._is_ok = False

    def check(self, what: str, whose: str = "rcl node's context") -> None:
        """Refuse a call after the shutdown, as rcl does."""
        if not self._is_ok:
            raise RCLError(f'{what}: {whose} is invalid')

    def get_domain_id(self) -> int:
        if not self._is_ok:
            raise RCLError('Failed to get domain id: error not set')
        return self._domain

    def gid(self) -> bytes:
        """Return a new identifier of an endpoint."""
        return self._prefix + next(self._numbers).to_bytes(16 - GID_BYTES, 'big')


class Node(Destroyable):
    """Stand-in for rcl's node, without its log."""

    def __init__(
        self,
        name: str,
        namespace: str,
        context: Context,
        cli_args: Sequence[str] | None,
        use_global_arguments: bool,
    ) -> None:
        super().__init__()
        if not context.ok():
            raise RCLError('error creating node: rcl context is not valid')
        self.context = context
        self.process, self.domain = context.process, context.domain
        words = cli_args or ()
        REAL.rclpy_remove_ros_args(words)  # which raises for what it does not know
        own = _Rules(words)
        everywhere = context.rules if use_global_arguments else _Rules(())
        renaming = own.renaming + everywhere.renaming
        # As in rcl: the first rule that matches, and the rules of a namespace see the new name.
        name = _renamed(renaming, name, '__node', '__name') or name
        namespace = _renamed(renaming, name, '__ns') or namespace
        namespace = namespace if (namespace or '').startswith('/') else f'/{namespace or ""}'
        self.name, self.namespace = name, namespace
        if problem := REAL.rclpy_get_validation_error_for_node_name(name):
            raise ValueError(f'invalid node name {name!r}: {problem}')
        if problem := REAL.rclpy_get_validation_error_for_namespace(namespace):
            raise ValueError(f'invalid namespace {namespace!r}: {problem}')
        self._renaming = [
            (rule.kind, self.expanded(rule.name), self.expanded(rule.value))
            for rule in renaming
            if not rule.name.startswith('__') and rule.node in ('', self.name)
        ]
        self._parameters = everywhere.parameters + own.parameters
        DOMAIN.nodes.append(self)
        self.rosout: Any = None
        owner = sys._getframe(2).f_locals.get('self')  # of rclpy, whose compiled nodes end when they are collected
        if owner is not None:
            weakref.finalize(owner, DOMAIN.vanish, lambda one: self in (one, getattr(one, 'node', None)))
        context.nodes.append(self)

    def _destroy(self) -> None:
        if self in DOMAIN.nodes:
            DOMAIN.nodes.remove(self)
        if self.rosout is not None and not self.rosout.is_ended:
            self.rosout.destroy_when_not_in_use()

    def expanded(self, name: str) -> str:
        """Return a name as a full one. Raises ValueError for an invalid one, as the real module."""
        full: str = REAL.rclpy_expand_topic_name(name, self.name, self.namespace)
        if invalid := REAL.rclpy_get_validation_error_for_full_topic_name(full):
            raise ValueError(invalid[0])
        return full

    def resolved(self, name: str, kind: str = 'topic') -> str:
        """Return the full name of a topic or service, after renaming."""
        full = self.expanded(name)
        return next((after for of, before, after in self._renaming if of in ('', kind) and before == full), full)

    def get_fully_qualified_name(self) -> str:
        return f'{self.namespace.rstrip("/")}/{self.name}'

    def logger_name(self) -> str:
        return self.get_fully_qualified_name()[1:].replace('/', '.')

    def get_node_name(self) -> str:
        return self.name

    def get_namespace(self) -> str:
        return self.namespace

    def ends(self, table: Mapping[tuple[str, str], Any], *sides: str, name: str = '') -> list[Any]:
        """Return the endpoints of all topics or services of this domain, or of one, in the order of names."""
        keys = [(self.domain, name)] if name else sorted(key for key in table if key[0] == self.domain)
        return [end for key in keys if key in table for side in sides for end in getattr(table[key], side)]

    def get_count_publishers(self, topic: str) -> int:
        self.context.check('Error in rcl_count_publishers')
        return len(self.ends(DOMAIN.topics, 'publishers', name=topic))

    def get_count_subscribers(self, topic: str) -> int:
        self.context.check('Error in rcl_count_subscribers')
        return len(self.ends(DOMAIN.topics, 'subscriptions', name=topic))

    def get_count_clients(self, service: str) -> int:
        self.context.check('Error in rcl_count_clients')
        return len(self.ends(DOMAIN.services, 'clients', name=service))

    def get_count_services(self, service: str) -> int:
        self.context.check('Error in rcl_count_services')
        return len(self.ends(DOMAIN.services, 'servers', name=service))

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        self.context.check('Failed to get node names')
        return [(node.name, node.namespace) for node in DOMAIN.nodes if node.domain == self.domain]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        return [(name, namespace, '/') for name, namespace in self.get_node_names_and_namespaces()]

    def get_action_names_and_types(self) -> list[tuple[str, list[str]]]:
        return self._actions(('servers', 'clients'))

    def get_action_server_names_and_types_by_node(self, name: str, namespace: str) -> list[tuple[str, list[str]]]:
        return self._actions(('servers',), (name, namespace))

    def get_action_client_names_and_types_by_node(self, name: str, namespace: str) -> list[tuple[str, list[str]]]:
        return self._actions(('clients',), (name, namespace))

    def _actions(self, sides: tuple[str, ...], of_node: tuple[str, str] | None = None) -> list[tuple[str, list[str]]]:
        self.context.check('Failed to get action names and type')
        if of_node is not None and of_node not in self.get_node_names_and_namespaces():
            raise RCLError('Failed to get action names and type: error not set')
        found: dict[str, set[str]] = {}
        for end in self.ends(DOMAIN.services, *sides):
            if end.service.endswith(_GOALS) and of_node in (None, (end.node.name, end.node.namespace)):
                found.setdefault(end.service.removesuffix(_GOALS), set()).add(
                    type_name(end.type).removesuffix('_SendGoal')
                )
        return [(name, sorted(types)) for name, types in found.items()]

    def get_parameters(self, parameter_class: Any) -> dict[str, Any]:
        """Return the parameters that files and arguments give this node, as rcl: later ones instead of earlier ones.

        But a pattern of nodes keeps the place of its first parameter, and what two parameters of one pattern and name
        give is of the type that comes first in :func:`_rank`.
        """
        groups: dict[str, dict[str, dict[int, Any]]] = {}
        for key, value in self._parameters:
            node, _, name = key.rpartition(':')
            content = _composed(Path(value).read_text() if not name else value)
            for pattern, part in [(node or '/**', content)] if name else _nodes('', content):
                for path, one in _flat(name, part):
                    groups.setdefault(pattern, {}).setdefault(path, {})[_rank(one)] = one
        given = {
            name: values[min(values)]
            for pattern, group in groups.items()
            if self._is_meant(pattern)
            for name, values in group.items()
        }
        # An empty list has no type.
        return {name: parameter_class(name, value=value if value != [] else None) for name, value in given.items()}

    def _is_meant(self, pattern: str) -> bool:
        """Return whether a name in a parameter file is that of this node; ``*`` is one part, ``**`` any number."""
        parts = ['(/[^/]+)*' if part == '**' else f'/{re.escape(part)}' for part in pattern.strip('/').split('/')]
        expression = ''.join(parts).replace(r'\*', '[^/]+')
        return re.fullmatch(expression, self.get_fully_qualified_name()) is not None


def _nodes(prefix: str, content: Any) -> Iterator[tuple[str, Any]]:
    """Yield the patterns of nodes in a parameter file, in which one may occur several times, with their parameters."""
    for name, inner in content.value if content is not None and content.id == 'mapping' else ():
        if name.value == 'ros__parameters':
            yield prefix, inner
        else:
            yield from _nodes(f'{prefix}/{name.value.strip("/")}' if prefix else name.value, inner)


def _flat(path: str, content: Any) -> Iterator[tuple[str, Any]]:
    if content is not None and content.id == 'mapping':
        for name, inner in content.value:
            yield from _flat(f'{path}.{name.value}' if path else name.value, inner)
    elif path:
        yield path, _plain(content)


def _rank(value: Any) -> int:
    """Return the place of the type of a parameter in rcl: truth, whole, real number, text, then lists of them."""
    first, lists = (value[0], 4) if isinstance(value, list) and value else (value, 0)
    return lists + next((n for n, kind in enumerate((bool, int, float, str)) if isinstance(first, kind)), 8)


_BOOLEANS: Final = {
    form: value
    for words, value in ((('y', 'yes', 'true', 'on'), True), (('n', 'no', 'false', 'off'), False))
    for word in words
    for form in (word, word.capitalize(), word.upper())
}
_INTEGER: Final = re.compile(r'[+-]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)')
_REAL_NUMBER: Final = re.compile(r'[+-]?((\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|infinity|\.?(inf|nan))', re.IGNORECASE)
_TEXT: Final = 'tag:yaml.org,2002:str'


def _composed(text: str) -> Any:
    import yaml

    class Loader(yaml.SafeLoader):
        DEFAULT_SCALAR_TAG = ''  # type: ignore[misc]  # so that a text that is marked as such differs

    return yaml.compose(text, Loader)


def _plain(node: Any) -> Any:
    """Return YAML as the parser of rcl reads it, which knows other numbers and booleans than PyYAML."""
    import yaml

    if isinstance(node, yaml.SequenceNode):
        return [_plain(one) for one in node.value]
    if node is None or node.style in ("'", '"') or node.tag == _TEXT:
        return node and node.value
    return _scalar(node.value)


def _scalar(text: str) -> bool | int | float | str:
    """Return a value that is not quoted, as ``get_value`` of rcl_yaml_param_parser."""
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if _INTEGER.fullmatch(text):
        digits = text.lstrip('+-').lower()
        base = 16 if digits.startswith('0x') else 8 if digits.startswith('0') else 10
        number = int(digits, base) * (-1 if text[0] == '-' else 1)
        if -(2**63) <= number < 2**63:
            return number
    if _REAL_NUMBER.fullmatch(text):
        value = float(text.lower().replace('.inf', 'inf').replace('.nan', 'nan'))
        is_too_small = abs(value) < sys.float_info.min and text.lower().partition('e')[0].strip('+-.0') != ''
        if (math.isfinite(value) and not is_too_small) or text[-1] in 'fFnNyY':
            return value
    return text


def type_name(kind: Any) -> str:
    """Return the name of an interface class, as ``std_msgs/msg/String``."""
    package, folder = kind.__module__.split('.')[:2]
    return f'{package}/{folder}/{kind.__name__}'


def check_support(kind: Any) -> None:
    """Raise what rclpy raises for a class that is no interface; load its type support."""
    from rclpy.type_support import check_for_type_support

    check_for_type_support(kind)
