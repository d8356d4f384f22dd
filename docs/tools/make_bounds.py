# SPDX-License-Identifier: BSD-3-Clause
"""Write the bounds in docs/reference/interfaces.md, from the constants that the code checks.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from target import target

from flexbt_common import files
from flexbt_common.calls import goal_server
from flexbt_common.lifecycle import presence
from flexbt_common.middleware import received_messages
from flexbt_common.values import limits, value_types
from flexbt_core.behavior_tree.script import parser, values
from flexbt_navigation.behaviors.server import MOST_DISTANCE, MOST_SPEED, MOST_TURN
from flexbt_onboard.behaviors import machine_store
from flexbt_onboard.commands import command_bounds, input_requests
from flexbt_onboard.link import console_link
from flexbt_onboard.persistence import event_log
from flexbt_server.actions import data_servers, execute_server
from flexbt_server.groot2 import server as groot2_server
from flexbt_server.leaves import leaf_services, topic_cache
from flexbt_server.navigators import bt_navigator
from flexbt_server.runs import run_logs
from flexbt_server.trees import blackboards
from flexbt_sim.world import FARTHEST
from flexbt_sim.world.plane.occupancy_map import MAX_CELLS, MAX_RESOLUTION, MIN_RESOLUTION

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'interfaces.md'
BEGIN: Final = '<!-- written by docs/tools/make_bounds.py -->\n'
END: Final = '<!-- end of what is written -->\n'
PARTS: Final = {'Goal': 'action', 'Request': 'srv', 'Response': 'srv'}
"""The suffix of a type's name, and the folder of the interface that it is part of."""


def bounds() -> Iterator[tuple[str, str]]:
    """Return the bounds of everything except fields."""
    yield 'a text that is not in the list below (name, key, frame, identifier)', f'{limits.TEXT:,} characters'
    yield 'a list that is not in it', f'{limits.LIST:,} elements'
    yield 'a message', f'{limits.MESSAGE:,} characters, bytes and elements in all'
    yield (
        'a command to the executive; those of one sender',
        (
            f'{console_link.COMMAND_BYTES:,} bytes; {console_link.COMMAND_RATE:g} a second, and '
            f'{console_link.COMMAND_BURST} at once'
        ),
    )
    yield 'its texts', lengths(command_bounds.COMMAND_LENGTHS)
    yield (
        'its arguments; its inputs',
        (
            f'{command_bounds.ARGUMENTS}, of {lengths(command_bounds.ARGUMENT_LENGTHS)}; {command_bounds.INPUTS}, of '
            f'{lengths(command_bounds.INPUT_LENGTHS)}'
        ),
    )
    yield 'pending input requests', f'{command_bounds.OPEN_REQUESTS}'
    yield (
        'a text for people from an executive',
        (f'{limits.LONG_TEXT:,} characters; the middle of a longer one is cut'),
    )
    yield 'YAML that is not JSON, as the text of a value', f'{value_types.MAX_YAML:,} characters'
    yield 'the name of a file; directories in it', f'{files.MAX_NAME:,} characters; {files.MAX_PARTS}'
    yield (
        'a message for a leaf that reads a topic',
        ', '.join(
            [
                f'{limits.MESSAGE:,} bytes',
                *(f'`{one.__name__}` {n:,}' for one, n in received_messages.MOST_BYTES.items()),
            ]
        ),
    )
    yield (
        'goals at a time',
        (
            f'`bt_executor` {execute_server.MOST_RUNS}; a navigator {bt_navigator.MOST_NAVIGATOR_GOALS}; `bt_loader` '
            f'{data_servers.MOST_LOADS}; `operator_input` {input_requests.MOST_REQUESTS}; any other action '
            f'{goal_server.MOST_GOALS:,}'
        ),
    )
    yield (
        'results of an action that can be requested again',
        (
            f'{goal_server.MOST_RESULTS:,}, and {goal_server.RESULTS_LENGTH:,} characters, bytes and elements, for '
            f'{goal_server.RESULT_SECONDS:g} s'
        ),
    )
    yield (
        'idle blackboards',
        (f'{blackboards.MOST_BLACKBOARDS}, the last ones named, and the shared one'),
    )
    yield (
        'entries of a blackboard; all values from outside',
        (f'{blackboards.MOST_KEYS:,}; {blackboards.MOST_VALUES:,} characters and bytes'),
    )
    yield (
        'a text made by an operator of a script; all texts of the blackboard then; a script',
        (f'{values.MAX_TEXT:,} characters; {values.MAX_TEXTS:,}; {parser.MAX_TOKENS:,} tokens'),
    )
    yield (
        'a stored machine; their number',
        (f'{machine_store.MACHINE_LENGTH:,} characters; {machine_store.MOST_MACHINES}'),
    )
    yield (
        'a place; turn, distance and speed of a motion',
        (f'±{FARTHEST:,.0f} m; ±{MOST_TURN:,.0f} rad, {MOST_DISTANCE:,.0f} m, {MOST_SPEED:g} m/s'),
    )
    yield 'a map; a cell of it', f'{MAX_CELLS:,} cells; {MIN_RESOLUTION:g} to {MAX_RESOLUTION:g} m'
    yield (
        "a frame of a message to Groot2's port",
        (f'{groot2_server.LARGEST_REQUEST:,} bytes; the connection is closed'),
    )
    yield (
        'cached topics and services of leaves while no tree needs them',
        (f'{topic_cache.MOST_TOPICS}; {leaf_services.MOST_SERVICES}'),
    )
    yield (
        'presence tokens that an executive accepts, of one process; of all',
        (f'{presence.TOKENS_OF_PARTICIPANT}; {presence.MOST_TOKENS}'),
    )
    yield (
        'queued for the disk: events; rounds of ticks',
        (f'{event_log.MOST_WAITING:,}; {run_logs.MOST_WAITING:,}'),
    )


def lengths(of: Mapping[str, int]) -> str:
    """Return characters, or bytes, of each field."""
    return ', '.join(f'`{name}` {count:,}' for name, count in of.items())


def fields() -> Iterator[tuple[str, str]]:
    """Return the fields with their own bound."""
    for key, bound in limits.LIMITS.items():
        package, _, path = key.partition('/')
        type_name, _, field = path.partition('.')
        name, _, part = type_name.partition('_')
        type = getattr(importlib.import_module(f'{package}.{PARTS.get(part, "msg")}'), name)
        length = unit(getattr(type, part) if part else type, field)
        yield f'`{path.replace("_", ".", 1) if part else path}`', f'{bound:,} {length}'


def unit(type: Any, field: str) -> str:
    """Return the unit of the length of a field."""
    kind = type.get_fields_and_field_types()[field.removesuffix('[]')]
    if kind == 'string' or field.endswith('[]'):
        return 'characters'
    return 'bytes' if kind in ('sequence<uint8>', 'sequence<octet>') else 'elements'


def page() -> str:
    """Return the whole page with the current bounds."""
    before, _, rest = PAGE.read_text(encoding='utf-8').partition(BEGIN)
    after = rest.partition(END)[2]
    table = ['| Data | Limit |\n|---|---|\n', *(f'| {what} | {most} |\n' for what, most in bounds())]
    by_bound: dict[str, list[str]] = {}
    for field, bound in fields():
        by_bound.setdefault(bound, []).append(field)
    items = ['Fields:\n\n', *(f'- {bound}: {", ".join(names)}\n' for bound, names in by_bound.items())]
    return '\n'.join([before + BEGIN, ''.join(table), ''.join(items), END + after])


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
