# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``console``: line mode with a command, the screen without one (or the prompt, where it cannot be).

Imports that a terminal user waits for come first and are few: ROS only when a command needs it.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib.util
import json
import os
import secrets
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Final, cast

from flexbt_common.command_line import abandon_stdout, is_full, keep_stdout_for_python, run_program
from flexbt_common.files import ALERTS, INCIDENTS, alone_in, home_path
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import check, command_help, overview, parse
from flexbt_console.commands.completion import ShellLine, as_typed, completion_script, read_line, shell_words
from flexbt_console.commands.effects import SCAN_PERIOD
from flexbt_console.commands.operator_values import full_namespace, load_places, port_number
from flexbt_console.commands.registry import find
from flexbt_console.commands.spec import NO_COMMAND, CommandLine, Mode
from flexbt_console.errors import ConsoleError, ExitCode, UsageError
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.freshness import LOST_SECONDS, LinkState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import FramedPose
from flexbt_console.mirror.view import View
from flexbt_console.present.json_form import encode_json, failure_json
from flexbt_console.present.style import Line, Tone, coloured, has_colours
from flexbt_core.clock.clock import seconds_asleep
from flexbt_core.values.text import escape_lines

from .terminal import TerminalWatch

if TYPE_CHECKING:
    from aiohttp import web

    from flexbt_common.runtime.node_runtime import NodeRuntime
    from flexbt_console.link.fleet_link import FleetLink
    from flexbt_console.link.operator_link import ExecutiveLink
    from flexbt_console.link.robot_link import RobotLink

    from .station import Station
    from .web.access import Access

PLACES_PARAMETER = 'places'
STUDIO_GROUP = 'flexbt.studio'
"""Entry point group by which a package adds the studio: a function of folder, access and robots that returns an aiohttp
application."""

DEFAULT_TIMEOUT = 5.0
"""Seconds to wait for the executive, and for its answer, when no --timeout is given."""

_INTERACTIVE = {Mode.PROMPT: 'prompt_toolkit', Mode.SCREEN: 'textual'}
"""The modes that need a terminal, and the library of each."""

COMPLETION_SECONDS = 1.5
"""Time for which the completion of a word waits for the robot, s."""

DEFAULT_PORT = 8465
"""Default port of the page."""

LEAVING = 'the robot continues'
"""Consequence of leaving for the robot."""

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_CLOSE_SECONDS = 10.0


class _Interrupted(KeyboardInterrupt):
    """SIGINT or SIGTERM, raised on the main thread; asyncio lets what is of this kind through, and nothing else."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the console and return its exit code (see :class:`ExitCode`).

    Call this on the main thread, because it handles SIGINT and SIGTERM.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)

    def run() -> int:
        exit_code = _run_words(words)
        _flush()
        return exit_code

    return run_program('console', run, ExitCode.FAULT)


def _run_words(words: list[str]) -> int:
    line = CommandLine()
    try:
        _raise_at_signals()
        line = parse(words)
        if line.has('--help'):
            print(overview() if line.spec is NO_COMMAND else command_help(line.spec))
            return ExitCode.OK
        if line.spec is NO_COMMAND:
            if not sys.stdin.isatty():
                print(overview(), file=sys.stderr)
                return ExitCode.USAGE
            # This terminal has to be able to place its cursor.
            can_show = _is_installed(_INTERACTIVE[Mode.SCREEN]) and os.environ.get('TERM', 'dumb') != 'dumb'
            line = replace(line, spec=find('screen' if can_show else 'prompt') or NO_COMMAND)
        check(line)
        return _run(line)
    except ConsoleError as error:
        return _report(words, line.spec.name, error.exit_code, str(error))
    except OSError as error:
        if error.filename is None:
            raise
        return _report(words, line.spec.name, ExitCode.USAGE, f'{error.filename}: cannot be used: {error.strerror}')
    except (_Interrupted, RuntimeError) as error:
        # A caller that waited for a lock when the signal arrived has lost it, and raises a RuntimeError.
        if not any(isinstance(one, _Interrupted) for one in (error, error.__context__)):
            raise
        endless = line.spec is not NO_COMMAND and isinstance(line.spec.action, Mode)
        return ExitCode.OK if endless else ExitCode.INTERRUPTED


def _is_installed(library: str) -> bool:
    return importlib.util.find_spec(library) is not None


def _flush() -> None:
    try:
        sys.stdout.flush()
    except OSError as error:
        if isinstance(error, BrokenPipeError) or is_full(error):
            raise
        abandon_stdout()  # the terminal is gone


def _run(line: CommandLine) -> ExitCode:
    action = line.spec.action
    if isinstance(action, Mode) and (run := _RUNS.get(action)):
        return run(line)
    from flexbt_console.ui.line.line_mode import LineMode, list_robots

    keep_stdout_for_python()
    with _open_runtime(line) as runtime:
        if action is Mode.ROBOTS:  # an observer is not present anywhere
            fleet = _fleet(line, runtime, None).fleet
            return list_robots(fleet, runtime.steady, _timeout(line), as_json=line.has('--json'))
        mirror, link = _parts(line, runtime)
        return LineMode(line, _station(line, runtime, mirror, link), link, runtime.steady).run()


def _complete(line: CommandLine) -> ExitCode:
    shell = line.first_word
    if not line.has('--line'):
        print(completion_script(shell), end='')
        return ExitCode.OK
    typed = read_line(line.value('--line'))
    if typed is None:
        return ExitCode.OK
    words, asks = shell_words(typed, View(LinkState.LOST, None))
    if asks:
        words, _ = shell_words(typed, *_known_of_robots(typed))
    for word in as_typed(words, typed, shell):
        print(word)
    return ExitCode.OK


def _known_of_robots(typed: ShellLine) -> tuple[View, tuple[str, ...]]:
    """Return the picture of the robot that a line is for, or which robots there are, if its name is what is typed."""
    named = {'--namespace': [typed.namespace]} if typed.namespace and not typed.names_robot else {}
    line = CommandLine(options={**named, '--observer': []})

    def is_known(view: View) -> bool | None:
        is_idle = view.snapshot is not None and not view.snapshot.run_id
        return (view.live and view.behaviors is not None and (is_idle or view.structure is not None)) or None

    keep_stdout_for_python()
    with _open_runtime(line) as runtime:
        if typed.names_robot:
            from flexbt_console.ui.line.line_mode import found_robots

            fleet = _fleet(line, runtime, None).fleet
            return View(LinkState.LOST, None), found_robots(fleet, runtime.steady, COMPLETION_SECONDS)
        mirror, link = _parts(line, runtime)
        link.wait_for(is_known, COMPLETION_SECONDS)
        return mirror.view(), ()


def _run_interactive(line: CommandLine) -> ExitCode:
    assert isinstance(line.spec.action, Mode)
    needs = _INTERACTIVE[line.spec.action]
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError(f'the interactive {line.spec.name} needs a terminal; use a command, see console --help')
    if not _is_installed(needs):
        raise UsageError(
            f'the interactive {line.spec.name} needs {needs}: install it, or use a command (console --help)'
        )
    run = _run_prompt if line.spec.action is Mode.PROMPT else _run_screen
    if run is _run_screen:  # whose lines of the log have their times, and little room for more
        os.environ.setdefault('RCUTILS_CONSOLE_OUTPUT_FORMAT', '{severity}: {message}')
    with _open_runtime(line) as runtime:
        with _watched_terminal(runtime.close) as watch:
            run(line, runtime, watch)
        return ExitCode.OK


@contextlib.contextmanager
def _watched_terminal(sign_off: Callable[[], object] = lambda: None) -> Iterator[TerminalWatch]:
    watch = TerminalWatch(sign_off)
    _raise_at_signals(watch.signaled)
    try:
        yield watch
    except (Exception, _Interrupted):  # whatever cannot be done to a terminal that is gone
        if not watch.has_given_up.is_set():
            raise
    finally:
        watch.close()


def _run_replay(line: CommandLine) -> ExitCode:
    from flexbt_console.recording.player import RunPlayer
    from flexbt_console.recording.run_file import RECORDING
    from flexbt_core.clock.clock import SteadyClock

    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UsageError('a recording is shown in a terminal; the executable `replay` publishes it for other consoles')
    file = Path(line.first_word)
    player = RunPlayer(file / RECORDING if file.is_dir() else file)
    if not _is_installed(_INTERACTIVE[Mode.SCREEN]):
        raise UsageError('the screen needs textual: install it, or use the executable `replay`')
    from flexbt_console.ui.screen.app import show_recording

    with _watched_terminal() as watch:
        show_recording(player, SteadyClock(), watch.on_signal)
    return ExitCode.OK


def _run_incidents(line: CommandLine) -> ExitCode:
    from flexbt_console.recording.incidents import PAGE, incident_named, incidents_in

    directory = home_path(line.value('--directory') or INCIDENTS)
    if not line.words:
        known = incidents_in(directory)
        value: dict[str, Any] = {'incidents': [one.facts for one in known]}
        text = '\n'.join(one.line for one in known) or f'no incidents in {directory}'
    else:
        found = incident_named(directory, '' if line.first_word == 'latest' else line.first_word)
        page = (found.folder / PAGE).read_text(encoding='utf-8', errors='replace')
        value, text = found.facts, f'{found.folder}\n\n{page}'.rstrip()
    print(json.dumps(value) if line.has('--json') else text)
    return ExitCode.OK


def _run_tree(line: CommandLine) -> ExitCode:
    from flexbt_console.ui.line.tree_run import run_tree

    keep_stdout_for_python()
    with _open_runtime(line) as runtime:
        return run_tree(line, runtime, _timeout(line), _places(line, runtime))


def _run_web(line: CommandLine) -> ExitCode:
    try:
        from flexbt_console.ui.web.access import Access
        from flexbt_console.ui.web.requests import LEAVING as PAGE_LEAVING
        from flexbt_console.ui.web.server import WebServer, print_address, run_web
    except ModuleNotFoundError as error:
        if error.name != 'aiohttp':
            raise
        raise UsageError('the page needs aiohttp: install it, or use a command (console --help)') from None
    from flexbt_console.link.simulator_link import SimulatorLink

    from .http_interface import HttpInterface
    from .station import Attention, Station

    folder = line.value('--studio')
    # The studio writes files, so it has a token on this computer, too.
    token = os.environ.get('FLEXBT_WEB_TOKEN', '') or (secrets.token_urlsafe(24) if folder else '')
    access = _access(line, Access.of(line.value('--address') or '127.0.0.1', token))
    only = dict.fromkeys(map(full_namespace, line.values('--robot')))
    with _open_runtime(line) as runtime:
        operator, simulator = _operator(line), SimulatorLink(runtime)
        attention_of = lru_cache(maxsize=64)(lambda name: Attention(runtime.steady))

        def station(mirror: Mirror, link: RobotLink, name: str) -> Station:
            builder, attention = CommandBuilder(name or operator), attention_of(name)
            return Station(mirror, link, builder, _timeout(line), attention, PAGE_LEAVING, obstacles=simulator)

        named = None if line.has('--observer') or _given_operator(line) else partial(operator_name, line)
        robots = _fleet(line, runtime, operator, list(only))
        studio = _studio()(folder, access, robots) if folder else None
        server = WebServer(robots, station, access, named)
        interface = HttpInterface(robots, station, access, lambda user: server.operator(user.name or 'program', user))
        run_web(server.application(studio=studio, api=interface.application()), access, _port(line), print_address)
        return ExitCode.OK


def _run_alerts(line: CommandLine) -> ExitCode:
    if not _is_installed('apprise'):
        raise UsageError('alerts need apprise, which calls people: install it (pip install apprise)')
    from flexbt_console.alerts.calling import Calling, check_lines, send_test
    from flexbt_console.alerts.delivered import SEND_SECONDS
    from flexbt_console.alerts.escalation import SeenRobot, seen
    from flexbt_console.alerts.rules import load_rules
    from flexbt_console.alerts.store import Store
    from flexbt_console.present.rendering import left_out_text
    from flexbt_console.ui.line.line_mode import found_robots, report_wait
    from flexbt_core.clock.clock import SteadyClock

    file = Path(line.first_word)
    rules = load_rules(file)
    if line.has('--test'):
        print(send_test(rules, line.value('--test')))
        return ExitCode.OK
    watching = replace(line, options={**line.options, '--observer': []})
    store = None
    if not line.has('--check'):
        with report_wait(SteadyClock(), lambda: 'the end of what an earlier program sends', SEND_SECONDS):
            store = Store(home_path(line.value('--state') or ALERTS))
    keep_stdout_for_python()
    with _open_runtime(watching) as runtime:
        fleet = _fleet(watching, runtime, None, rules.robots).fleet

        def look() -> list[SeenRobot]:
            return [seen(robot) for robot in fleet.overview()]

        if store is None:
            found_robots(fleet, runtime.steady, _timeout(line))
            print('\n'.join([*check_lines(rules, look()), *left_out_text(fleet.left_out, '"robots" of the file')]))
            return ExitCode.OK
        calling = Calling(file, store, look, runtime.node.get_logger(), lambda: fleet.left_out * (not fleet.is_growing))
        print(f'alerts: {len(rules.rules)} rules of {file}  (Ctrl-C ends it; the robots continue)', flush=True)
        calling.run()
    return ExitCode.OK


def _access(line: CommandLine, access: Access) -> Access:
    """Return the access with the users and the certificate of the line. Raises UsageError."""
    import ssl

    from .web.access import certificate_problem
    from .web.users import Users

    users = Users(Path(line.value('--users'))) if line.has('--users') else None
    certificate, file, key = None, line.value('--certificate'), line.value('--key')

    def no_passphrase() -> str:
        raise UsageError('the key has a passphrase; use one without, which only you can read')

    if line.has('--certificate'):
        certificate = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            certificate.load_cert_chain(file, key or None, no_passphrase)
            problem = certificate_problem(certificate, file)
        except (OSError, ValueError) as error:
            both = f'--certificate {file} {f"with --key {key}" if key else "without --key"}'
            raise UsageError(f'{both}: cannot be used: {getattr(error, "strerror", None) or error}') from None
        if problem:
            text = f'--certificate {file}: {problem}; browsers warn of it, and programs refuse it: renew it'
            print(coloured(Line(text, Tone.WARNING), has_colours(sys.stderr)), file=sys.stderr)
    elif line.has('--key'):
        raise UsageError('--key needs --certificate')
    return replace(access, users=users, certificate=certificate)


def _run_users(line: CommandLine) -> ExitCode:
    from .web.users import NAME, User, read_users, role_of, token_hash, write_users

    file, new, gone = Path(line.first_word), line.value('--add'), line.value('--remove')
    token = secrets.token_urlsafe(24)
    if new and not NAME.fullmatch(new):
        raise UsageError(f'--add {new!r}: a name has letters, digits, and . _ @ -, at most 64')
    if line.has('--role') and not new:
        raise UsageError('--role needs --add, which gives a new token to a user who is there')
    with alone_in(file.parent) if new or gone else contextlib.nullcontext():
        users = list(read_users(file).values()) if file.exists() or not new else []
        if gone and gone not in {user.name for user in users}:
            raise UsageError(f'{file}: has no user {gone!r}')
        users = [user for user in users if user.name not in (new, gone)]
        if new:
            users.append(User(new, role_of(line.value('--role') or 'operator', '--role'), token_hash(token)))
        if new or gone:
            write_users(file, users)
    if new:
        print(f'token of {new}, which is shown only now: {token}\nIn a browser, add it to the address: #token={token}')
    else:
        print('\n'.join(f'{user.name}  {user.role.name.lower()}' for user in users) or 'no users')
    return ExitCode.OK


def _studio() -> Callable[[str, Access, FleetLink], web.Application]:
    """Return what makes the application of the studio, from the package that has it."""
    for point in entry_points(group=STUDIO_GROUP):
        return cast('Callable[[str, Access, FleetLink], web.Application]', point.load())
    raise UsageError('--studio needs the package flexbt_studio, which is not installed')


_RUNS: Final[Mapping[Mode, Callable[[CommandLine], ExitCode]]] = {
    Mode.WEB: _run_web,
    Mode.ALERTS: _run_alerts,
    Mode.REPLAY: _run_replay,
    Mode.INCIDENTS: _run_incidents,
    Mode.USERS: _run_users,
    Mode.RUN_TREE: _run_tree,
    Mode.COMPLETION: _complete,
    Mode.PROMPT: _run_interactive,
    Mode.SCREEN: _run_interactive,
}


def _port(line: CommandLine) -> int:
    return port_number(line.value('--port') or str(DEFAULT_PORT))


def _run_prompt(line: CommandLine, runtime: NodeRuntime, watch: TerminalWatch) -> None:
    mirror, link = _parts(line, runtime)
    from flexbt_console.ui.line.prompt import run_prompt  # while the robot is discovered

    run_prompt(_station(line, runtime, mirror, link), runtime.steady, watch.on_signal)


def _run_screen(line: CommandLine, runtime: NodeRuntime, watch: TerminalWatch) -> None:
    robots = _fleet(line, runtime, _operator(line))
    mirror, link = robots.select(robots.own)
    from flexbt_console.ui.screen.app import run_screen  # while the robots are discovered

    station = _station(line, runtime, mirror, link)
    run_screen(station, runtime.steady, watch.on_signal, robots)


def _station(line: CommandLine, runtime: NodeRuntime, mirror: Mirror, link: RobotLink) -> Station:
    from .station import Attention, Station

    builder, attention = CommandBuilder(_operator(line)), Attention(runtime.steady)
    leaving = line.value('--leaving') or LEAVING
    return Station(mirror, link, builder, _timeout(line), attention, leaving, line.value('--page'))


def _parts(line: CommandLine, runtime: NodeRuntime) -> tuple[Mirror, ExecutiveLink]:
    from flexbt_console.link.operator_link import ExecutiveLink

    mirror = _mirror_maker(line, runtime)()
    return mirror, ExecutiveLink(runtime, mirror, _operator(line))


def _fleet(line: CommandLine, runtime: NodeRuntime, operator: str | None, only: Sequence[str] = ()) -> FleetLink:
    from flexbt_console.link.fleet_link import FleetLink

    return FleetLink(runtime, Fleet(), _mirror_maker(line, runtime), operator, _scan_period(line), only)


def _scan_period(line: CommandLine) -> float:
    return 0.0 if line.has('--slow-link') else line.seconds('--scan-period') or SCAN_PERIOD


def _mirror_maker(line: CommandLine, runtime: NodeRuntime) -> Callable[[], Mirror]:
    places, lost_after = _places(line, runtime), line.seconds('--lost-after') or LOST_SECONDS
    return lambda: Mirror(runtime.steady, places, lost_after, seconds_asleep)


def _operator(line: CommandLine) -> str | None:
    return None if line.has('--observer') else operator_name(line)


def _timeout(line: CommandLine) -> float:
    return line.seconds('--timeout') or DEFAULT_TIMEOUT


@contextlib.contextmanager
def _open_runtime(line: CommandLine) -> Iterator[NodeRuntime]:
    from flexbt_common import names
    from flexbt_common.runtime.node_runtime import NodeRuntime

    arguments = list(line.ros_arguments)
    namespace = line.value('--namespace')
    if namespace:
        arguments += ['--ros-args', '-r', f'__ns:={full_namespace(namespace)}']
    # A signal must not interrupt this thread after the executor thread has started and before we have the runtime.
    # (Masking it is not enough: threads of the middleware would receive it.)
    came: list[int] = []
    for known in _SIGNALS:
        signal.signal(known, lambda number, frame: came.append(number))
    try:
        name = names.OBSERVER if line.has('--observer') else names.CONSOLE
        runtime = NodeRuntime(name, args=[name, *arguments])
    except Exception as error:  # whatever rcl finds wrong with the arguments or the middleware
        raise UsageError(f'cannot join ROS: {error}') from error
    finally:
        _raise_at_signals()
    try:
        if came:
            raise _Interrupted
        yield runtime
    finally:
        _ignore_signals()
        # If the middleware hangs at the end, the process ends anyway, and reports where.
        with contextlib.suppress(RuntimeError):  # no thread is left for it
            faulthandler.dump_traceback_later(_CLOSE_SECONDS, exit=True, file=2)
        runtime.close()
        faulthandler.cancel_dump_traceback_later()


def _places(line: CommandLine, runtime: NodeRuntime) -> dict[str, FramedPose]:
    """Return this console's own places, from the first file that is set: by option, environment variable, or parameter
    of the node."""
    file = line.value('--places') or os.environ.get('FLEXBT_PLACES', '')
    if not file:
        node = runtime.node
        file = runtime.call(lambda: node.declare_parameter(PLACES_PARAMETER, '').value)
    return load_places(Path(file)) if file else {}


def _given_operator(line: CommandLine) -> str:
    return line.value('--operator') or os.environ.get('FLEXBT_OPERATOR', '')


def operator_name(line: CommandLine, user: str = '') -> str:
    """Return the operator: the option, the environment, or user@host/place. By default ``user`` is the one who has
    logged in.

    The executive takes commands under one name from one console at a time, and one person may have several open on one
    computer. The place distinguishes them: ``page`` (of another port than the usual one ``page8466``), or the terminal
    as in ``pts3``. A script without a terminal has none.
    """
    if given := _given_operator(line):
        return given
    import getpass
    import socket

    try:
        user = user or getpass.getuser()
    except (KeyError, OSError):
        user = str(os.getuid())
    return '/'.join(filter(None, (f'{user}@{socket.gethostname()}', _place(line))))


def _place(line: CommandLine) -> str:
    if line.spec.action is Mode.WEB:
        port = _port(line)
        return 'page' if port == DEFAULT_PORT else f'page{port or os.getpid()}'
    for descriptor in range(3):
        with contextlib.suppress(OSError):
            return os.ttyname(descriptor).removeprefix('/dev/').replace('/', '')
    return ''


def _report(words: list[str], name: str, exit_code: ExitCode, reason: str) -> int:
    if {'--json', '--jsonl'} & set(words):
        print(encode_json(failure_json(name, exit_code, reason)))
    else:
        word = 'refused: ' if exit_code is ExitCode.REFUSED else ''
        prefix = f'{name}: ' if name else 'console: '
        colours = has_colours(sys.stderr)
        for text in escape_lines(prefix + word + reason):
            print(coloured(Line(text, Tone.ERROR), colours), file=sys.stderr)
    return exit_code


def _raise_at_signals(tell: Callable[[int], object] = lambda number: None) -> None:
    """Raise _Interrupted on the main thread at the first signal; further ones cannot disturb the orderly end."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        _ignore_signals()
        tell(number)
        raise _Interrupted

    for known in _SIGNALS:
        signal.signal(known, interrupt)


def _ignore_signals() -> None:
    for known in _SIGNALS:
        signal.signal(known, signal.SIG_IGN)


if __name__ == '__main__':
    sys.exit(main())
