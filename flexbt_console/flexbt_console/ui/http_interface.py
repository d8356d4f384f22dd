# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP interface of the console: status, commands, events, incidents and recordings, below ``/api/``.

A command is one of line mode, with its arguments and options as the keys of a JSON object. Line mode itself reads it,
sends it and awaits its answer; the exit code becomes the status of the answer. ``/api/openapi.json`` describes it all.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
import uuid
from collections import OrderedDict
from collections.abc import Callable, Coroutine, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from importlib.metadata import version
from math import isfinite
from typing import TYPE_CHECKING, Any, Final, TypeVar

from aiohttp import web
from aiohttp.typedefs import Handler

from flexbt_common.files import INCIDENTS, USER_DIRECTORY, home_path
from flexbt_console.commands.command_line import check, parse
from flexbt_console.commands.registry import COMMANDS, role_for
from flexbt_console.commands.spec import CommandLine, CommandSpec, Option, Send
from flexbt_console.errors import ConsoleError, ExitCode, UsageError
from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import CommandKind
from flexbt_console.present.events import Follower
from flexbt_console.present.json_form import encode_json, failure_json, robots_json, status_json
from flexbt_console.recording.incidents import files_in, incident_named, incidents_in
from flexbt_core.clock.clock import SteadyClock
from flexbt_core.clock.rates import SenderRates
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import did_you_mean, one_line, short_repr

from .answers import Meaning
from .line.line_mode import LineMode
from .station import Station
from .web.access import Access, WrongTokens, source_of
from .web.past import Recordings
from .web.server import open_robot
from .web.users import User

if TYPE_CHECKING:
    from flexbt_console.link.fleet_link import FleetLink
    from flexbt_console.link.robot_link import RobotLink

T = TypeVar('T')

OWN: Final = '_'
"""Name of the robot without a namespace, in a path."""

BODY_BYTES: Final = 1_000_000
"""Maximum size of the body of a request."""

MOST_AT_ONCE: Final = 32
MOST_STOPS: Final = 128
"""Commands that are carried out at the same time, streams of events that are open, and stops: a program may stop all
robots of a fleet at once. A user has half of these places."""

QUICK_BYTES: Final = 10_000
"""Maximum size of a body that is read on the thread of the loop: within milliseconds, whatever it is."""

BODY_SECONDS: Final = 20.0
"""Time in which the body of a request has to arrive, s."""

KEY_CHARACTERS: Final = 200
MOST_KEYS: Final = 10_000
"""Characters of an idempotency key, and keys that are remembered."""

RATE: Final = 20.0
BURST: Final = 100
"""Requests of a user: per second, and at once."""

OPEN_SECONDS: Final = 30.0
"""Time for which a robot stays open after a request, s: what a command needs to know is there for the next one."""

EVENT_SECONDS: Final = 0.2
IDLE_SECONDS: Final = 15.0
"""Time between two looks for events, and after which a stream without events sends a comment, s."""

STATUS: Final = {
    ExitCode.OK: HTTPStatus.OK,
    ExitCode.USAGE: HTTPStatus.BAD_REQUEST,
    ExitCode.REFUSED: HTTPStatus.CONFLICT,
    ExitCode.TIMEOUT: HTTPStatus.GATEWAY_TIMEOUT,
    ExitCode.NO_LINK: HTTPStatus.SERVICE_UNAVAILABLE,
    ExitCode.FAULT: HTTPStatus.INTERNAL_SERVER_ERROR,
}
"""HTTP statuses of exit codes."""

_BYTES: Final = 'application/octet-stream'
READS: Final[Mapping[str, tuple[str, str, str]]] = {
    '/robots': (
        'list_robots',
        'list the robots, the most urgent first; left_out: how many more were found',
        'application/json',
    ),
    '/robots/{robot}': ('status_of_robot', 'status of a robot', 'application/json'),
    '/robots/{robot}/events': ('events_of_robot', 'events of a robot, as a stream', 'text/event-stream'),
    '/incidents': ('list_incidents', 'list the incidents, newest first', 'application/json'),
    '/incidents/{name}/{file}': ('file_of_incident', 'file of an incident', _BYTES),
    '/recordings': ('list_recordings', 'list the recordings', 'application/json'),
    '/recordings/{name}': ('recording', 'recording', _BYTES),
}
"""What is read by GET: operation, text, and type of the answer, by path."""

_KEY: Final = 'Idempotency-Key'
_NAMESPACE: Final = uuid.UUID('0b5de8ad-52a5-4cc8-8f6e-8a60a55d7a39')
_LEFT_OUT: Final = frozenset({'--file', '--png', '--size', '--scan', '--state'})


class _Performance(LineMode):
    """A command of line mode whose answer is kept instead of printed. ``identifier``: that of its command, or ''.
    ``stops``: number of STOPs before it was requested."""

    def __init__(self, line: CommandLine, station: Station, link: Any, identifier: str, stops: int) -> None:
        super().__init__(line, station, link, SteadyClock())
        self._identifier = identifier
        self._stops = stops
        self.value: Any = None

    def run(self) -> ExitCode:
        """See :meth:`LineMode.run`. What was sent before with its identifier is not made anew of what is there now: a
        decision that it has answered is gone. It is sent again if it is unanswered, and nobody has stopped the robot
        since."""
        known = self._mirror.command(self._identifier) if self._identifier else None
        if known is None:
            return super().run()
        may_be_sent = known.command.kind is CommandKind.STOP or known.command.stops == self._stops
        if known.state is CommandState.TIMEOUT and may_be_sent:
            snapshot = self._seen()[0].snapshot
            executive = snapshot.executive_id if snapshot and known.command.executive_id else ''
            again = replace(known.command, executive_id=executive)
            self._station.link.send(again, self._station.timeout, known.label)
        return self._wait_for_answer(known.command)

    def tell(self, value: Any, text: list[str], prefix: str = '') -> None:
        """Keep the last answer."""
        self.value = {'text': [str(one) for one in text]} if value is None else value

    def waiting_for(self, what: Callable[[], str]) -> AbstractContextManager[None]:
        """Tell nobody."""
        return nullcontext()

    def identified(self, meaning: Meaning) -> Meaning:
        """See :meth:`LineMode.identified`."""
        if meaning.command is None:
            return meaning
        identifier = self._identifier or meaning.command.id
        return replace(meaning, command=replace(meaning.command, id=identifier, stops=self._stops))


def perform(
    line: CommandLine, station: Station, link: Any, identifier: str = '', stops: int | None = None
) -> tuple[ExitCode, Any]:
    """Carry out a command, and return its exit code and its answer for programs. Not on the executor thread."""
    name = line.spec.name
    one = _Performance(line, station, link, identifier, station.mirror.view().stops if stops is None else stops)
    try:
        check(line)
        return one.run(), one.value
    except ConsoleError as error:
        return error.exit_code, failure_json(name, error.exit_code, str(error))


def line_of(spec: CommandSpec, given: Mapping[str, Any]) -> CommandLine:
    """Return the line of a command from the keys of a JSON object; see :func:`schema_of`.

    Raises:
        UsageError: a key is unknown, a value has the wrong type, or an argument is missing.
    """
    words: list[str] = []
    known = [*(key_of(one.name) for one in spec.arguments), *(key_of(one.name) for one in options_of(spec))]
    for key in given:
        if key not in known:
            raise UsageError(f'{spec.name} has no {short_repr(key)}{did_you_mean(key, known)}')
    for argument in spec.arguments:
        value = given.get(key_of(argument.name))
        texts = [] if value is None else _texts(value, argument.repeated, argument.name)
        if argument.required and not texts:
            raise UsageError(f'{spec.name}: {key_of(argument.name)!r} is missing')
        words += texts
    options: list[str] = []
    for option in options_of(spec):
        value = given.get(key_of(option.name))
        if option.value is None:
            if value is not None and not isinstance(value, bool):
                raise UsageError(f'{key_of(option.name)!r} is true or false, not {short_repr(value)}')
            options += [option.name] * bool(value)
        elif value is not None:
            options += [word for text in _texts(value, option.repeated, option.name) for word in (option.name, text)]
    line = parse([*spec.name.split(), *options, '--', *words])
    if line.ros_arguments:
        raise UsageError(f'{line.ros_arguments[0]!r} is for the command line, and no value')
    return line


def _texts(value: Any, is_repeated: bool, name: str) -> list[str]:
    several = value if isinstance(value, list) and is_repeated else [value]
    for one in several:
        if isinstance(one, bool) or not (isinstance(one, str | int) or (isinstance(one, float) and isfinite(one))):
            what = 'texts or numbers' if is_repeated else 'a text or a number'
            raise UsageError(f'{key_of(name)!r} has to be {what}, not {short_repr(value)}')
    return [str(one) for one in several]


def key_of(name: str) -> str:
    """Return the key of an argument or option."""
    return name.lstrip('-').lower().split('=')[0].replace('-', '_').replace(' ', '_')


def options_of(spec: CommandSpec) -> list[Option]:
    """Return the options of a command that programs may give."""
    return [one for one in spec.options if one.name not in _LEFT_OUT]


def offered() -> list[CommandSpec]:
    """Return the commands for programs: all but those that are modes of a terminal."""
    return [spec for spec in COMMANDS if spec.in_prompt]


@contextlib.contextmanager
def _place(taken: list[str], most: int, user: str, what: str) -> Iterator[None]:
    """Take one of the places for what goes on at the same time, during a ``with`` block.

    Raises HTTPServiceUnavailable if none is free.
    """
    if len(taken) >= most or taken.count(user) >= most // 2:
        text = f'{len(taken)} {what} go on, {taken.count(user)} of them yours; try again later'
        raise web.HTTPServiceUnavailable(text=text)
    taken.append(user)
    try:
        yield
    finally:
        taken.remove(user)


class HttpInterface:
    """The interface. ``station`` makes the station of an operator, whose name ``operator`` makes from a user's."""

    def __init__(
        self,
        robots: FleetLink,
        station: Callable[[Mirror, RobotLink, str], Station],
        access: Access,
        operator: Callable[[User], str],
    ) -> None:
        self._robots, self._station, self._access, self._operator = robots, station, access, operator
        self._wrong = WrongTokens()
        self._rates = SenderRates(RATE, BURST, time.monotonic)
        self._commands, self._stops, self._streams = list[str](), list[str](), list[str]()  # by their users
        self._threads = ThreadPoolExecutor(MOST_AT_ONCE + MOST_STOPS, 'commands')  # so a stop waits for nothing
        self._aside_threads = ThreadPoolExecutor(2, 'aside')
        self._keys: OrderedDict[str, str] = OrderedDict()
        self._works: OrderedDict[str, asyncio.Future[tuple[ExitCode, str]]] = OrderedDict()
        self._recorded = Recordings(home_path(USER_DIRECTORY))
        self._open: dict[tuple[str, str], asyncio.TimerHandle] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_over = False

    def application(self) -> web.Application:
        """Return the application to be mounted at ``/api/``."""
        application = web.Application(middlewares=[self._known])
        application.router.add_get('/openapi.json', self._description)
        application.router.add_post('/robots/{robot}/commands/{command}', self._command)
        for path, (operation, _, content) in READS.items():
            file_path = f'{path[:-1]}:.+}}' if content == _BYTES else path  # its last part may have slashes
            application.router.add_get(file_path, getattr(self, f'_{operation}'))
        application.on_shutdown.append(self._end_streams)
        application.on_cleanup.append(self._end)
        return application

    async def _end_streams(self, _application: web.Application) -> None:
        self._is_over = True

    async def _end(self, _application: web.Application) -> None:
        for threads in (self._threads, self._aside_threads):
            threads.shutdown(wait=False, cancel_futures=True)

    @web.middleware
    async def _known(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Answer only users, and not too often; turn errors into answers."""
        source = source_of(request.remote)
        if wait := self._access.wait(self._wrong, source):
            return _problem(HTTPStatus.TOO_MANY_REQUESTS, f'wrong tokens came from here; try again in {wait:.0f} s')
        scheme, _, token = request.headers.get('Authorization', '').partition(' ')
        user = self._access.user_of(token.strip() if scheme.lower() == 'bearer' else '')
        if user is None:
            if token:
                self._wrong.note(source)
            answer = _problem(HTTPStatus.UNAUTHORIZED, 'send "Authorization: Bearer TOKEN" with the token of a user')
            answer.headers['WWW-Authenticate'] = 'Bearer'
            return answer
        # The number of stops is limited by their places.
        is_stop = request.method == 'POST' and request.path.endswith('/commands/stop')
        if not is_stop and not self._rates.allows(user.name.encode() or source.encode()):
            return _problem(HTTPStatus.TOO_MANY_REQUESTS, f'more than {RATE:g} requests a second')
        request['user'], request['share'] = user, user.name or source
        try:
            return await handler(request)
        except web.HTTPException as error:
            return _problem(HTTPStatus(error.status), error.text or error.reason)
        except ConsoleError as error:
            return _problem(STATUS[error.exit_code], str(error))
        except (KeyError, RuntimeError, TimeoutError) as error:  # forgotten just now; no threads; the node is busy
            return _problem(HTTPStatus.SERVICE_UNAVAILABLE, f'this cannot be done now: {error!r}')

    async def _description(self, _request: web.Request) -> web.Response:
        return _json(description())

    async def _list_robots(self, _request: web.Request) -> web.Response:
        def listed() -> web.Response:
            fleet = self._robots.fleet
            robots = [{**one, 'robot': _segment(one['robot'])} for one in robots_json(fleet.overview())]
            return _json({'robots': robots, 'left_out': fleet.left_out})

        return await self._aside(listed)

    async def _status_of_robot(self, request: web.Request) -> web.Response:
        mirror = self._robots.robot(self._name(request))[0]
        return await self._aside(lambda: _json(status_json(mirror.view())))

    async def _aside(self, work: Callable[[], T]) -> T:
        """Do what may take long, on another thread: a STOP waits for what is done on the thread of the loop."""
        return await asyncio.get_running_loop().run_in_executor(self._aside_threads, work)

    async def _command(self, request: web.Request) -> web.Response:
        """Carry out a command for a user; wait for its answer."""
        user, robot = request['user'], self._name(request)
        name = request.match_info['command'].replace('_', ' ').replace('-', ' ')
        specs = {spec.name.replace('-', ' '): spec for spec in offered()}
        if name not in specs:
            raise web.HTTPNotFound(text=f'there is no command {short_repr(name)}{did_you_mean(name, specs)}')
        spec = specs[name]
        if user.role < role_for(spec):
            what = f'{spec.name} needs the role {role_for(spec).name.lower()}; {user.name} has {user.role.name.lower()}'
            raise web.HTTPForbidden(text=what)
        stops = self._robots.robot(robot)[0].view().stops
        data, loop = await _body(request), asyncio.get_running_loop()
        reading = partial(_line_in, data, spec)
        line, wanted = reading() if len(data) <= QUICK_BYTES else await self._aside(reading)
        identifier = self._identifier(request, robot, wanted)
        is_stop, share = spec.name == 'stop', request['share']
        places = self._stops if is_stop else self._commands
        with _place(places, MOST_STOPS if is_stop else MOST_AT_ONCE, share, 'stops' if is_stop else 'commands'):
            operator = self._operator(user)
            if is_stop:  # the link is there already: a stop does not wait for the node, which may be busy
                self._begin(self._keep_open(robot, operator))
            else:
                await self._keep_open(robot, operator)
            mirror, link = self._robots.robot(robot)
            station = replace(self._station(mirror, link, operator), role=user.role)
            doing = partial(_performed, line, station, link, identifier, stops)
            work = self._works.get(identifier)
            if work is None or (work.done() and (work.exception() or work.result()[0] is not ExitCode.OK)):
                work = loop.run_in_executor(self._threads, doing)
            if identifier and isinstance(spec.action, Send):  # a request that is repeated has the same answer
                self._works[identifier] = work
                self._works.move_to_end(identifier)
                if len(self._works) > MOST_KEYS:
                    self._works.popitem(last=False)
            code, text = await asyncio.shield(work)  # a program that is gone does not take its command back
        return _answer(text, STATUS[code])

    def _identifier(self, request: web.Request, robot: str, wanted: str) -> str:
        """Return the identifier of a command by the key of its request, '' without one."""
        key = request.headers.get(_KEY, '')
        if not key:
            return ''
        if not (key.isascii() and key.isprintable() and len(key) <= KEY_CHARACTERS):
            raise UsageError(f'{_KEY} has to be at most {KEY_CHARACTERS} printable ASCII characters')
        seat = f'{request["user"].name}\n{robot}\n{key}'
        identifier = uuid.uuid5(_NAMESPACE, f'{seat}\n{wanted}').hex
        if self._keys.setdefault(seat, identifier) != identifier:
            raise web.HTTPUnprocessableEntity(text=f'another request had this {_KEY}; nothing was sent')
        self._keys.move_to_end(seat)
        if len(self._keys) > MOST_KEYS:
            self._keys.popitem(last=False)
        return identifier

    async def _events_of_robot(self, request: web.Request) -> web.StreamResponse:
        """Send the events of a robot from now on, as server-sent events; the first ones are the present state.

        The operator is present at the robot meanwhile, and so keeps the authority.
        """
        robot, operator = self._name(request), self._operator(request['user'])
        answer = web.StreamResponse(headers={'Content-Type': 'text/event-stream', 'Cache-Control': 'no-cache'})
        place = _place(self._streams, MOST_AT_ONCE, request['share'], 'streams')
        with place, contextlib.suppress(ConnectionError, KeyError):
            await self._keep_open(robot, operator)
            follower = Follower(self._robots.robot(robot)[0])
            await answer.prepare(request)
            silent_since, loop = time.monotonic(), asyncio.get_running_loop()
            while (transport := request.transport) and not self._is_over and self._access.admits(request['user']):
                await self._keep_open(robot, operator)
                told = await self._aside(partial(_events_text, follower, self._robots.robot(robot)[0]))
                if told or time.monotonic() > silent_since + IDLE_SECONDS:
                    unread = loop.call_later(IDLE_SECONDS, transport.abort)
                    await answer.write((told or ': still here\n\n').encode())
                    unread.cancel()
                    silent_since = time.monotonic()
                await asyncio.sleep(EVENT_SECONDS)
        return answer

    async def _list_incidents(self, _request: web.Request) -> web.Response:
        def shown() -> list[dict[str, Any]]:
            known = incidents_in(home_path(INCIDENTS))
            return [{'name': one.folder.name, 'files': files_in(one.folder), **one.facts} for one in known]

        return _json({'incidents': await asyncio.to_thread(shown)})

    async def _file_of_incident(self, request: web.Request) -> web.StreamResponse:
        found = await asyncio.to_thread(incident_named, home_path(INCIDENTS), request.match_info['name'])
        file = request.match_info['file']
        if file not in await asyncio.to_thread(files_in, found.folder):
            raise web.HTTPNotFound(text=f'{found.folder.name} has no {short_repr(file)}')
        return web.FileResponse(found.folder / file)

    async def _list_recordings(self, _request: web.Request) -> web.Response:
        return _json({'recordings': await asyncio.to_thread(self._recorded.names)})

    async def _recording(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(await asyncio.to_thread(self._recorded.file, request.match_info['name']))

    def _name(self, request: web.Request) -> str:
        """Return the robot of a path."""
        given = request.match_info['robot']
        name = '/' if given == OWN else f'/{given}'
        if name not in self._robots.fleet.names:
            known = [_segment(one) for one in self._robots.fleet.names]
            raise web.HTTPNotFound(text=f'no robot {short_repr(given)} was found{did_you_mean(given, known)}')
        return name

    async def _keep_open(self, robot: str, operator: str) -> None:
        """Let all of a robot be received from now on, and for a while after the last call."""
        seat, loop = (robot, operator), asyncio.get_running_loop()
        if seat not in self._open:
            await open_robot(self._robots, robot, operator)
            if seat in self._open:  # another request was faster
                await asyncio.to_thread(self._robots.close, *seat)
        if seat in self._open:
            self._open[seat].cancel()
        self._open[seat] = loop.call_later(OPEN_SECONDS, self._close, seat)

    def _close(self, seat: tuple[str, str]) -> None:
        del self._open[seat]
        self._begin(asyncio.to_thread(self._robots.close, *seat))

    def _begin(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


async def _body(request: web.Request) -> bytes:
    """Return the body of a request. Raises UsageError."""
    try:
        async with asyncio.timeout(BODY_SECONDS):
            data = await request.clone(client_max_size=BODY_BYTES).read()
    except TimeoutError:
        raise web.HTTPRequestTimeout(text=f'the body has not arrived within {BODY_SECONDS:g} s') from None
    except (web.RequestPayloadError, ConnectionError) as error:
        raise UsageError(f'the body cannot be read: {one_line(str(error), 200)}') from None
    if data and request.content_type != 'application/json':
        raise web.HTTPUnsupportedMediaType(text='the body is JSON: Content-Type: application/json')
    return data


def _line_in(data: bytes, spec: CommandSpec) -> tuple[CommandLine, str]:
    """Return the line of a command from the body of its request, and what is wanted, written the same whenever it is
    the same. Raises UsageError."""
    try:
        given = load_json(data.decode(), object_pairs_hook=_object) if data else {}
    except (ValueError, RecursionError) as error:
        raise UsageError(f'the body is not JSON: {one_line(str(error), 200)}') from None
    if not isinstance(given, dict):
        raise UsageError(f'the body has to be an object, not {short_repr(given)}')
    return line_of(spec, given), json.dumps([spec.name, given], sort_keys=True)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len(dict(pairs)) < len(pairs):
        raise ValueError('an object has a key twice')
    return dict(pairs)


def _performed(*arguments: Any) -> tuple[ExitCode, str]:
    """Return the result of :func:`perform` as text, which takes long if it is large."""
    code, value = perform(*arguments)
    return code, encode_json(value)


def _events_text(follower: Follower, mirror: Mirror) -> str:
    """Return the new events of a robot as server-sent events."""
    told = ((one.name, encode_json({'time': time.time(), **one.value})) for one in follower.events(mirror.view()))
    return ''.join(f'event: {name}\ndata: {data}\n\n' for name, data in told)


def _json(value: Any, status: HTTPStatus = HTTPStatus.OK) -> web.Response:
    return _answer(encode_json(value), status)


def _answer(text: str, status: HTTPStatus) -> web.Response:
    return web.Response(text=text, status=status, content_type='application/json')


def _problem(status: HTTPStatus, text: str) -> web.Response:
    return _json({'result': status.phrase.lower(), 'reason': one_line(text, 2000)}, status)


def _segment(robot: str) -> str:
    return robot.strip('/') or OWN


# The description of the interface, OpenAPI 3.1.


def schema_of(spec: CommandSpec) -> dict[str, Any]:
    """Return the JSON schema of the object that a command takes."""
    properties: dict[str, Any] = {}
    for argument in spec.arguments:
        properties[key_of(argument.name)] = _schema(argument.name, argument.repeated)
    for option in options_of(spec):
        text = one_line(option.help, 500)
        is_flag = option.value is None
        shown = {'type': 'boolean'} if is_flag else _schema(option.value or '', option.repeated)
        properties[key_of(option.name)] = {**shown, 'description': text}
    required = [key_of(argument.name) for argument in spec.arguments if argument.required]
    return {'type': 'object', 'properties': properties, 'additionalProperties': False} | (
        {'required': required} if required else {}
    )


def _schema(written: str, is_repeated: bool) -> dict[str, Any]:
    one = {'type': ['string', 'number'], 'description': f'as {written} of the command line'}
    return {'type': 'array', 'items': one} if is_repeated else one


def _in_path(name: str) -> dict[str, Any]:
    return {'name': name, 'in': 'path', 'required': True, 'schema': {'type': 'string'}}


def description() -> dict[str, Any]:
    """Return the OpenAPI document."""
    robot = _in_path('robot') | {'description': f'namespace of the robot; {OWN} for the one without'}
    key = {'name': _KEY, 'in': 'header', 'schema': {'type': 'string', 'maxLength': KEY_CHARACTERS}}
    key['description'] = 'a request with the same key has its effect once'
    paths: dict[str, Any] = {}
    for path, (operation, what, content) in READS.items():
        named = [part[1:-1] for part in path.split('/') if part.startswith('{')]
        first, *more = operation.split('_')
        paths[path] = {
            'get': {
                'summary': what,
                'operationId': first + ''.join(map(str.title, more)),
                'parameters': [robot if name == 'robot' else _in_path(name) for name in named],
                'responses': {'200': {'description': what, 'content': {content: {'schema': _ANY}}}, **_PROBLEMS},
            }
        }
    for spec in offered():
        path = f'/robots/{{robot}}/commands/{spec.name.replace(" ", "_")}'
        words = spec.name.replace('-', ' ').title().replace(' ', '')
        body: dict[str, Any] = {'content': {'application/json': {'schema': schema_of(spec)}}}
        body |= {'required': any(argument.required for argument in spec.arguments)}
        paths[path] = {
            'post': {
                'summary': one_line(spec.summary, 300),
                'description': ' '.join([*spec.details, f'Role: {role_for(spec).name.lower()}.']),
                'operationId': words[0].lower() + words[1:] + 'Command',
                'parameters': [robot, *([key] if isinstance(spec.action, Send) else [])],
                'requestBody': body,
                'responses': {
                    '200': {'description': 'the answer', 'content': {'application/json': {'schema': _ANY}}},
                    **_PROBLEMS,
                },
            }
        }
    return {
        'openapi': '3.1.0',
        'info': {
            'title': 'FlexBT',
            'version': version('flexbt_console'),
            'description': 'Robots, their missions, incidents and recordings, for programs.',
            'license': {'name': 'BSD-3-Clause', 'identifier': 'BSD-3-Clause'},
        },
        'servers': [{'url': '/api'}],
        'security': [{'token': []}],
        'paths': paths,
        'components': {
            'securitySchemes': {'token': {'type': 'http', 'scheme': 'bearer'}},
            'schemas': {
                'Problem': {
                    'type': 'object',
                    'properties': {'result': {'type': 'string'}, 'reason': {'type': 'string'}},
                    'required': ['result', 'reason'],
                }
            },
        },
    }


_ANY: Final[dict[str, Any]] = {'type': 'object'}
_PROBLEMS: Final = {
    str(int(status)): {
        'description': text,
        'content': {'application/json': {'schema': {'$ref': '#/components/schemas/Problem'}}},
    }
    for status, text in (
        (HTTPStatus.BAD_REQUEST, 'not written as it has to be'),
        (HTTPStatus.UNAUTHORIZED, 'the token is missing or wrong'),
        (HTTPStatus.FORBIDDEN, 'the role is too low'),
        (HTTPStatus.NOT_FOUND, 'there is no such robot, command or file'),
        (HTTPStatus.CONFLICT, 'refused: it had no effect'),
        (HTTPStatus.UNPROCESSABLE_ENTITY, 'another request had the same Idempotency-Key'),
        (HTTPStatus.TOO_MANY_REQUESTS, 'too many requests'),
        (HTTPStatus.SERVICE_UNAVAILABLE, 'the executive is not heard'),
        (HTTPStatus.GATEWAY_TIMEOUT, 'no answer in time; it is not known whether the command had an effect'),
    )
}
