# SPDX-License-Identifier: BSD-3-Clause
"""Places of states and transitions: Graphviz lays out one container at a time, the inner ones first.

A picture has the unit pixel; y points down.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any, Final

from flexbt_studio.errors import StudioError
from flexbt_studio.worker import Worker

LAYOUT_SECONDS: Final = 10.0
"""Time for one container, s; then Graphviz is ended. 60 states with 180 transitions take 0.2 s."""
MOST_STATES: Final = 120
"""States of one container that are laid out; more are arranged as a list."""
REMEMBERED: Final = 256

HEADER: Final = 34.0
"""Height of the title of a container, pixels."""
_MARGIN: Final = 12.0
_LETTER: Final = 7.4
_SMALL_LETTER: Final = 6.6
_POINTS: Final = 72.0


class Layouts:
    """Layouts of containers. Answers of Graphviz are remembered by their graph."""

    def __init__(self) -> None:
        self._made: OrderedDict[str, dict[str, Any]] = OrderedDict()
        self._worker = Worker('flexbt_studio.server.layout_worker')

    def close(self) -> None:
        """End Graphviz."""
        self._worker.close()

    def machine(self, states: Sequence[Mapping[str, Any]], folded: Sequence[str]) -> dict[str, Any]:
        """Return the layout of a machine, by the ``states`` of a view and the paths of the ``folded`` containers.

        ``states`` has ``[x, y, width, height]`` by path; ``ends`` the box of each outcome of a container, by path and
        outcome; ``edges`` the curve (an SVG path) and the place of the label of each transition.
        """
        children: dict[str, list[Mapping[str, Any]]] = {}
        for state in states:
            children.setdefault(state['parent'] if state['parent'] is not None else '', []).append(state)
        root = children.get('', [None])[0]
        if root is None:
            return {'width': 0, 'height': 0, 'states': {}, 'ends': {}, 'edges': []}
        sizes: dict[str, tuple[float, float]] = {}
        layouts: dict[str, dict[str, Any]] = {}
        closed = set(folded)
        for state in reversed(states):  # parents come first, so inner ones are ready here
            path = state['path']
            if state['kind'] in ('state', 'behavior') or path in closed:
                sizes[path] = _box(state, is_folded=path in closed)
                continue
            layouts[path] = made = self._container(state, children.get(path, []), sizes)
            sizes[path] = made['width'] + 2 * _MARGIN, made['height'] + HEADER + _MARGIN
        found: dict[str, Any] = {'states': {}, 'ends': {}, 'edges': []}
        found['width'], found['height'] = sizes[root['path']]
        self._place(root['path'], 0.0, 0.0, sizes, layouts, found)
        return found

    def _place(
        self,
        path: str,
        x: float,
        y: float,
        sizes: Mapping[str, tuple[float, float]],
        layouts: Mapping[str, dict[str, Any]],
        found: dict[str, Any],
    ) -> None:
        """Add the places of a state and of what it contains, with its upper left corner at ``x``, ``y``."""
        waiting = [(path, x, y)]
        while waiting:
            path, x, y = waiting.pop()
            found['states'][path] = [x, y, *sizes[path]]
            made = layouts.get(path)
            if made is None:
                continue
            left, top = x + _MARGIN, y + HEADER
            for child, (child_x, child_y) in made['states'].items():
                waiting.append((child, left + child_x, top + child_y))
            found['ends'][path] = {name: [left + a, top + b, w, h] for name, (a, b, w, h) in made['ends'].items()}
            for edge in made['edges']:
                points = [[left + a, top + b] for a, b in edge['points']]
                label = edge['label'] and [left + edge['label'][0], top + edge['label'][1]]
                found['edges'].append({**edge, 'points': points, 'label': label, 'in': path})

    def _container(
        self,
        container: Mapping[str, Any],
        children: Sequence[Mapping[str, Any]],
        sizes: Mapping[str, tuple[float, float]],
    ) -> dict[str, Any]:
        if len(children) > MOST_STATES:
            return _as_list(children, sizes)
        dot = _dot(container, children, sizes)
        answer = self._made.pop(dot, None)
        if answer is None:
            answer = self._laid_out(dot)
        self._made[dot] = answer
        while len(self._made) > REMEMBERED:
            self._made.popitem(last=False)
        return _read(answer, container, children, sizes)  # the graph has no labels: they may have changed

    def _laid_out(self, dot: str) -> dict[str, Any]:
        """Return Graphviz's answer. Raises StudioError if it gives none in time."""
        program = shutil.which('dot')
        try:
            if program is not None:
                return dict(json.loads(_run([program, '-Tjson0'], dot)))
            answer = self._worker.ask({'dot': dot}, LAYOUT_SECONDS)
        except (OSError, ValueError, subprocess.SubprocessError) as error:
            raise StudioError(f'the machine could not be laid out: Graphviz: {error}; it is shown as text') from error
        if 'error' in answer:
            raise StudioError(f'the machine could not be laid out: {answer["error"]}; it is shown as text')
        return dict(answer['layout'])

    def start(self) -> None:
        """Load Graphviz, so that the first layout is quick. Raises OSError."""
        if shutil.which('dot') is None:
            self._worker.start()


def _run(command: Sequence[str], text: str) -> str:
    done = subprocess.run(  # noqa: S603
        command, input=text, capture_output=True, text=True, timeout=LAYOUT_SECONDS, check=True
    )
    return done.stdout


def _box(state: Mapping[str, Any], *, is_folded: bool) -> tuple[float, float]:
    """Return width and height of a state that shows nothing inside."""
    longest = max(len(state['label']) * _LETTER + 22, len(state['type'] or '') * _SMALL_LETTER)
    return min(max(longest + 28, 96.0), 320.0), 48.0 + 8.0 * is_folded


def _dot(
    container: Mapping[str, Any], children: Sequence[Mapping[str, Any]], sizes: Mapping[str, tuple[float, float]]
) -> str:
    """Return the graph of one container: its entry, its states as boxes of known size, and its outcomes."""
    places = {child['label']: index for index, child in enumerate(children)}
    lines = ['digraph {', 'rankdir=TB; nodesep=0.45; ranksep=0.5', 'node [shape=box, fixedsize=true, label=""]']
    lines += ['edge [fontname=Courier, fontsize=12]', 'begin [width=0.2, height=0.2]']  # each letter is 7.2 pixels wide
    for index, child in enumerate(children):
        width, height = sizes[child['path']]
        lines.append(f's{index} [width={width / _POINTS:.3f}, height={height / _POINTS:.3f}]')
    for number, outcome in enumerate(container['outcomes']):
        width = len(outcome) * _LETTER + 28
        lines.append(f'o{number} [width={width / _POINTS:.3f}, height={26 / _POINTS:.3f}]')
    outcomes = {name: number for number, name in enumerate(container['outcomes'])}
    first = [child for child in children if container['kind'] == 'concurrency' or child.get('initial')] or children[:1]
    lines += [f'begin -> s{places[child["label"]]} [id="begin"]' for child in first]
    for index, child in enumerate(children):
        for number, way in enumerate(child.get('transitions', ())):
            target = way['target']
            end = f's{places[target]}' if target in places else f'o{outcomes[target]}' if target in outcomes else ''
            if end:
                label = 'x' * (len(way['outcome']) + 1)
                lines.append(f's{index} -> {end} [id="{index}/{number}", label={label}]')
    return '\n'.join([*lines, '}'])


def _read(
    answer: Mapping[str, Any],
    container: Mapping[str, Any],
    children: Sequence[Mapping[str, Any]],
    sizes: Mapping[str, tuple[float, float]],
) -> dict[str, Any]:
    """Return the places in Graphviz's answer, whose y points up."""
    left, bottom, right, top = map(float, answer['bb'].split(','))

    def point(text: str) -> list[float]:
        x, y = text.split(',')
        return [float(x) - left, top - float(y)]

    made: dict[str, Any] = {'width': right - left, 'height': top - bottom, 'states': {}, 'ends': {}, 'edges': []}
    for node in answer.get('objects', ()):
        x, y = point(node['pos'])
        width, height = float(node['width']) * _POINTS, float(node['height']) * _POINTS
        name = node['name']
        if name == 'begin':
            made['begin'] = [x, y]
        elif name.startswith('s'):
            child = children[int(name[1:])]
            width, height = sizes[child['path']]
            made['states'][child['path']] = [x - width / 2, y - height / 2]
        else:
            outcome = container['outcomes'][int(name[1:])]
            made['ends'][outcome] = [x - width / 2, y - height / 2, width, height]
    for edge in answer.get('edges', ()):
        index, _, number = edge['id'].partition('/')
        tip = next((point(part[2:]) for part in edge['pos'].split() if part.startswith('e,')), None)
        points = [point(part) for part in edge['pos'].split() if part[0] not in 'es']
        made['edges'].append(
            {
                'from': '' if index == 'begin' else children[int(index)]['path'],
                'outcome': '' if index == 'begin' else children[int(index)]['transitions'][int(number)]['outcome'],
                'points': points,
                'tip': None,
                'label': point(edge['lp']) if 'lp' in edge else None,
            }
        )
        if tip is not None:
            made['edges'][-1]['points'] = [*points, tip, tip, tip]
    return made


def _as_list(children: Sequence[Mapping[str, Any]], sizes: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """Return the states one below the other, without transitions."""
    made: dict[str, Any] = {'width': 0.0, 'height': 0.0, 'states': {}, 'ends': {}, 'edges': []}
    for child in children:
        width, height = sizes[child['path']]
        made['states'][child['path']] = [0.0, made['height']]
        made['width'], made['height'] = max(made['width'], width), made['height'] + height + _MARGIN
    return made
