# SPDX-License-Identifier: BSD-3-Clause
"""Requests of a page: read with bounds, and carried out on the robots, as prompt and screen do it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from typing import Any, Final

from flexbt_console.commands.completion import candidates
from flexbt_console.commands.spec import Reading, Role
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.mirror.records import OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_console.ui.answers import Bound, Local, Meaning, choose
from flexbt_console.ui.station import RobotRequest, Session, Station
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import one_line

LEAVING: Final = 'close the page: the robot continues'
"""Answer to "quit" on a page."""


MESSAGE_BYTES: Final = 65_536
"""Maximum bytes of a message of a page."""

RATE: Final = 20.0
"""Messages a second that a page may send for long; BURST at once."""

BURST: Final = 60


def read(text: str) -> dict[str, Any]:
    """Return the decoded message of a page.

    Raises:
        UsageError: it is invalid.
    """
    try:
        message = load_json(text)
    except (ValueError, RecursionError):
        raise UsageError('the message is not JSON') from None
    if not isinstance(message, dict):
        raise UsageError('the message is not a JSON object')
    return message


NAME_CHARACTERS: Final = 40
"""Maximum characters of the name of a page's user."""


def operator_name(hello: dict[str, Any]) -> str:
    """Return the name that a page gives for its user, '' for none: one line, without what is not printable."""
    given = hello.get('operator')
    return one_line(' '.join(given.split()), NAME_CHARACTERS) if isinstance(given, str) else ''


MOST_FOLDED: Final = 500
"""Maximum number of containers of a machine that are folded in a page."""


def folded_paths(message: dict[str, Any]) -> frozenset[str]:
    """Return the paths of the containers that a page has folded.

    Raises:
        UsageError: they are not a list of texts, or too many.
    """
    paths = message['fold']
    if not isinstance(paths, list) or len(paths) > MOST_FOLDED or not all(isinstance(path, str) for path in paths):
        raise UsageError(f'"fold" is a list of at most {MOST_FOLDED} paths of containers')
    return frozenset(paths)


SHOWS_PAST: Final = (
    'this page shows the past; nothing was sent. Go back to now first (Esc); only STOP is sent from here'
)


def is_harmless(message: dict[str, Any]) -> bool:
    """Return whether a page that shows the past may ask for this: a stop, and what sends nothing."""
    return is_stop(message) or not message.keys() & {'do', 'answer', 'obstacle', 'remove_obstacle'}


def is_stop(message: dict[str, Any]) -> bool:
    """Return whether it is a stop."""
    line = message.get('do')
    return isinstance(line, str) and line.lower().split(None, 1)[:1] == ['stop']


QUICK_CHARACTERS: Final = 1000
"""Maximum characters of a message that is read within milliseconds, whatever it is."""


def past_of(message: dict[str, Any]) -> tuple[str, float | None]:
    """Return the name of the recording of a request, '' for the robot's past, and its time or revision.

    Raises:
        UsageError: they are not a text and a number.
    """
    name, number = message.get('of', ''), message.get('lanes', message.get('moment'))
    is_number = isinstance(number, int | float) and not isinstance(number, bool) and abs(number) < 1e15
    if not isinstance(name, str) or not (is_number or number is None):
        raise UsageError('"lanes" is a revision, "moment" a time in s or null, "of" the name of a recording')
    return name, number


Told = OperatorCommand | Reading
"""The result of a request: the command that was sent, or lines to read. Lines without a title are for the log."""

PageRequest = Callable[[], Told]
"""A request that has to wait for the robot or the simulator, and ends with the page. Raises ConsoleError."""


def understood(
    message: dict[str, Any], session: Session, left: Future[None], stops: int
) -> Callable[[], Told | dict[str, Any] | PageRequest | None]:
    """Read a request of a page, and return what carries it out.

    Reading a long value takes long. What is returned does not; it returns a dictionary to send it to the page. Only a
    :data:`PageRequest` waits for anybody.

    ``left`` is done once the page is closed: what is synthesized for it is canceled. ``stops`` is the number of STOPs
    before the request.

    Raises:
        ConsoleError: the request is invalid, or cannot work now; nothing was sent. What is returned raises it, too.
    """
    station = session.station
    if 'complete' in message:
        text = _text(message, 'complete')
        found = {'candidates': [text, candidates(text, station.mirror.view())[:40]]}
        return lambda: found
    if 'obstacle' in message:
        return lambda: partial(_obstacle, message['obstacle'], station)
    if 'remove_obstacle' in message:
        return lambda: partial(_remove_obstacle, _text(message, 'remove_obstacle'), station)
    view = replace(station.mirror.view(), stops=stops)
    decision_id = message.get('decision')
    if decision_id is not None and not isinstance(decision_id, str):
        raise UsageError('"decision" is the identifier of a decision, or null')
    if message.keys() == {'touched', 'decision'}:
        return lambda: station.attention.touched(view, decision_id)
    if 'answer' in message:
        station.permit(None)
        decision = Bound(decision_id).decision(view)
        unseen = message.get('unseen') is True
        meaning = choose(_text(message, 'answer'), view, station.builder, decision, unseen=unseen)
        return partial(_done, meaning, view, session, left)
    if 'do' in message:
        meaning = session.interpret(_text(message, 'do'), view, Bound(decision_id))
        return partial(_done, meaning, view, session, left)
    raise UsageError(
        'unknown request; expected one of: '
        'do, answer, touched, complete, fold, lanes, moment, recordings, obstacle, remove_obstacle'
    )


def _done(meaning: Meaning, view: View, session: Session, left: Future[None]) -> Told | PageRequest | None:
    if meaning.local is Local.QUIT:
        return Reading(None, [session.station.leaving])
    done = session.carry_out(meaning, view)
    if isinstance(done, RobotRequest):
        return partial(done.ask, session.station.link, _ignore, left)
    return done


def _ignore(text: str) -> None:
    """Ignore the progress of a synthesis: a page shows its end only."""


def _obstacle(where: object, station: Station) -> Reading:
    if not (
        isinstance(where, list)
        and len(where) == 2
        and all(isinstance(one, int | float) and not isinstance(one, bool) and abs(one) < 1e6 for one in where)
    ):
        raise UsageError('"obstacle" is [x, y], in m')
    name = _simulator(station).drop(float(where[0]), float(where[1]), station.timeout)
    return Reading(None, [f'{name} dropped at x {where[0]:.2f}  y {where[1]:.2f}'])


def _remove_obstacle(name: str, station: Station) -> Reading:
    _simulator(station).remove(name, station.timeout)
    return Reading(None, [f'{name} removed'])


def _simulator(station: Station) -> Any:
    if station.builder.operator is None:
        raise RefusedError('an observer cannot drop obstacles; omit --observer')
    station.require(Role.OPERATOR, 'an obstacle')
    if station.obstacles is None or not station.obstacles.is_possible():
        raise RefusedError('there is no simulator that serves simulation_interfaces; obstacles cannot be dropped here')
    return station.obstacles


def _text(message: dict[str, Any], key: str) -> str:
    text = message[key]
    if not isinstance(text, str):
        raise UsageError(f'"{key}" is a text')
    return text
