# SPDX-License-Identifier: BSD-3-Clause
"""Reader of a model's main file: ``<roaml>``, or ``<convince_mc_tc>`` in older models."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree.model.errors import LoadError

from .ascxml import Ascxml, Timer, period_of, ports_of
from .data_types import DataTypes
from .dialect import SET, Events, bt_event
from .handlers import handlers
from .properties import Judge, ModelProperty, PropertyError, event_of, judge_of, read_properties
from .rounds import ModelPath, Order
from .source_text import ModelError, SourceElement, read_text, read_xml
from .system import ModelSystem
from .tree import TreePlayer

_UNITS: Final = {'s': 1_000_000_000, 'ms': 1_000_000, 'us': 1_000, 'ns': 1}
_ROOTS: Final = ('roaml', 'convince_mc_tc')
_CLOCK: Final = 'topic_clock_msg'
_KINDS: Final = {
    'behavior_tree': ('bt.cpp-xml', 'bt-plugin-ascxml', 'bt-plugin-ros-scxml'),
    'node_models': ('node-ascxml', 'ros-scxml'),
    'properties': ('jani',),
    'data_declarations': ('xml', 'json'),
}
_SECTIONS: Final = ('parameters', 'mc_parameters', *_KINDS)


def is_model(text: str) -> bool:
    """Return whether a document is the main file of a model."""
    match = re.match(r'\ufeff?(?:\s|<\?[^>]*>|<!--.*?-->)*<([\w.-]+)', text, re.DOTALL)
    return match is not None and match.group(1) in _ROOTS


class RoamlModel:
    """The contents of a model's files. Attributes: ``properties``; ``is_random``, true if the model uses
    Math.random."""

    def __init__(self, path: str) -> None:
        """Read all files. Raises TreeLoadError with file, line, what is wrong, and what to do."""
        self.path = path
        root = read_xml(path)
        if root.tag not in _ROOTS:
            root.fail('the main file of a model begins with <roaml>')
        root.only(_SECTIONS)
        self._folder = Path(path).parent
        self._rate, self._keeps_ticking, self._end, most = 1.0, False, 0, 100
        parameters = root.find('parameters') or root.find('mc_parameters')
        if parameters is None:
            root.fail('<parameters> are missing; they have at least <max_time value="100" unit="s"/>')
        for one in parameters.children:
            if one.tag == 'max_time':
                unit = one.get('unit') or ''
                if unit not in _UNITS:
                    one.fail(f'the unit {unit!r} is not known; there are {", ".join(_UNITS)}', 'unit')
                self._end = round(one.number('value', most=1e18) * _UNITS[unit])
            elif one.tag == 'max_array_size':
                most = int(one.number('value', most=10_000))
            elif one.tag == 'bt_tick_rate':
                self._rate = one.number('value')
            elif one.tag == 'bt_tick_if_not_running':
                if one.need('value').strip().lower() not in ('true', 'false'):
                    one.fail('the value has to be true or false', 'value')
                self._keeps_ticking = one.need('value').strip().lower() == 'true'
            else:
                one.fail(
                    'this parameter is not known; there are max_time, max_array_size, bt_tick_rate and '
                    'bt_tick_if_not_running'
                )
        if not self._end:
            parameters.fail('<max_time value="100" unit="s"/> is missing')
        self._types = DataTypes(most)
        for one in self._inputs(root, 'data_declarations'):
            self._types.read(one, self._file(one))
        self.tree: TreePlayer | None = None
        self.events = Events()
        files = self._files(root)
        self.is_random = any(file.is_random for file in files)
        self.properties: list[ModelProperty] = []
        for one in self._inputs(root, 'properties'):
            self.properties += read_properties(self._file(one), one)
        if not self.properties:
            root.fail('there are no properties; add <properties><input type="jani" src="..."/></properties>')
        for asked in self.properties:
            self._watched(asked)

    def _inputs(self, root: SourceElement, section: str) -> list[SourceElement]:
        node = root.find(section)
        if node is None:
            return []
        node.only(('input',))
        for one in node.children:
            if one.need('type') not in _KINDS[section]:
                one.fail(
                    f'the type {one.need("type")!r} is not known in <{section}>; there are '
                    f'{", ".join(_KINDS[section])}',
                    'type',
                )
        return list(node.children)

    def _file(self, node: SourceElement) -> str:
        return os.path.normpath(self._folder / node.need('src'))

    def _files(self, root: SourceElement) -> list[Ascxml]:
        """Read the files of the automata, and build the tree."""
        events, types = self.events, self._types
        files = []
        for one in self._inputs(root, 'node_models'):
            files.append(Ascxml(read_xml(self._file(one), one), types, events))
        self._plugins: list[Ascxml] = []
        trees = [one for one in self._inputs(root, 'behavior_tree') if one.need('type') == 'bt.cpp-xml']
        if len(trees) > 1:
            trees[1].fail('a model has one file with its tree')
        plugins: dict[str, SourceElement] = {}
        for one in self._inputs(root, 'behavior_tree'):
            if one.need('type') != 'bt.cpp-xml':
                document = read_xml(self._file(one), one)
                if document.need('name') in plugins:
                    document.fail('another plugin has the same name', 'name')
                plugins[document.need('name')] = document
        if trees:
            ports = {name: ports_of(document, types) for name, document in plugins.items()}
            path = self._file(trees[0])
            self._player = partial(TreePlayer, path, read_text(path, trees[0]), ports)
            self.tree = self._player()
            for instance in self.tree.instances:
                self._plugins.append(Ascxml(plugins[self.tree.plugin(instance.uid)], types, events, instance))
        elif plugins:
            next(iter(plugins.values())).fail('there is a plugin, but no tree; add an <input type="bt.cpp-xml" .../>')
        self._nodes = files
        whole = [*files, *self._plugins]
        names: set[str] = set()
        for file in whole:
            file.declare()
            if file.name in names:
                raise ModelError([LoadError(self.path, 1, 1, '', f'two automata have the name {file.name!r}')])
            names.add(file.name)
        between = handlers([one for file in whole for one in file.communications], events)
        for handler in between:
            handler.declare()
        for event, parameters in zip(events.names, events.parameters, strict=True):
            for record, member in permutations(parameters, 2):
                if member.startswith(f'{record}__'):
                    message = f'{event} is sent with {record} as a whole, and with {member} alone; choose one of them'
                    raise ModelError([LoadError(self.path, 1, 1, '', message)])
        events.send(_CLOCK, ('ros_fields__sec', 'ros_fields__nanosec'))
        if self.tree is not None:
            for node in self.tree.nodes:
                events.send(bt_event(node.uid, 'response'), ('status',))
            for instance in self.tree.instances:
                events.send(bt_event(instance.uid, 'tick'))
                events.send(bt_event(instance.uid, 'halt'))
                for child in instance.children:
                    events.send(bt_event(child, 'response_told'), ('status',))
                    events.send(bt_event(child, 'halt_response_told'))
            for key in self.tree.keys:
                events.send(SET + key, ('value',))
        of_nodes = [one for file in files for one in file.automata()]
        of_tree = [one for file in self._plugins for one in file.automata()]
        received = {event for automaton in of_tree for event in automaton.received}
        for instance in self.tree.instances if self.tree is not None else ():
            if self.tree is not None and events.number(bt_event(instance.uid, 'tick')) not in received:
                plugins[self.tree.plugin(instance.uid)].fail('no state of this plugin has <bt_tick>: it never answers')
        self._automata = [*of_nodes, *of_tree, *(handler.automaton() for handler in between)]
        return whole

    def _watched(self, one: ModelProperty) -> tuple[list[int], Judge, Judge]:
        """Return the events that a property uses, and the judges of its two sides. Raises ModelError."""
        found: list[int] = []
        try:
            for name in one.names:
                event = event_of(re.sub(r'\.d\d+_len$', '', name), self.events)[0]
                number = self.events.find(event)
                if number is None:
                    raise PropertyError(f'there is no event {event!r} in this model')
                if number not in found:
                    found.append(number)
            return found, judge_of(one.left, self.events, found), judge_of(one.right, self.events, found)
        except PropertyError as error:
            raise ModelError([LoadError(self.path, 1, 1, '', f'the property {one.name!r}: {error}')]) from error

    def along(self, one: ModelProperty, order: Order, draw: Callable[[], float]) -> ModelPath:
        """Return the path of a property through the model. ``draw`` returns random numbers in [0, 1)."""
        watched, left, right = self._watched(one)
        timers = [timer for file in self._nodes for timer in file.timers]
        if self.tree is not None:
            timers.append(Timer('the tick of the tree', period_of(self._rate), None))
        timers += [timer for file in self._plugins for timer in file.timers]
        system = ModelSystem(
            self._automata,
            None if self.tree is None else self._player(),
            timers,
            self.events,
            end=self._end,
            keeps_ticking=self._keeps_ticking,
            clock=self.events.number(_CLOCK),
            watched=watched,
            draw=draw,
        )
        return ModelPath(system, left, right, one, order)
