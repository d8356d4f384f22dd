# SPDX-License-Identifier: BSD-3-Clause
"""The open pages: their requests, one after the other, and what they are told about edits of one another.

Messages are JSON. A page sends ``{"id": 1, "method": "open", "arguments": {…}}`` and gets ``{"id": 1, "result": …}`` or
``{"id": 1, "error": {"kind": "conflict", "message": "…"}}``. Events have no id: ``{"event": "edited", …}``.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import secrets
import traceback
from collections.abc import Callable, Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from itertools import count
from typing import TYPE_CHECKING, Any, Final

from aiohttp import WSCloseCode, WSMsgType, web

from flexbt_core.values.text import did_you_mean, one_line, short_repr
from flexbt_studio.errors import ConflictError, GestureError, StudioError
from flexbt_studio.machine_checks import MachineChecks
from flexbt_studio.tool_process import checked

from .groot2_robot import PREFIX, Groot2Robot, robot_name
from .jobs import Jobs
from .layouts import Layouts
from .live import LiveRobots, past_answer
from .page_text import PageText
from .recordings import PREFIX as RECORDING
from .recordings import decide_copy, log_of, opened
from .simulator import NAME as SIMULATION
from .simulator import Simulation, behavior_files, project_files, worlds
from .versions import revisions, text_at
from .workbench import Workbench, shown_finding

if TYPE_CHECKING:
    from flexbt_console.link.fleet_link import FleetLink
    from flexbt_console.ui.web.access import Access
    from flexbt_console.ui.web.past import Past, Recordings

MESSAGE_BYTES: Final = 8 << 20
"""Maximum size of a message of a page, bytes: a whole file of the greatest size fits."""
MOST_WAITING: Final = 64
"""Maximum number of requests of one page that wait; more are refused."""
SEND_SECONDS: Final = 20.0
MOST_PROGRAMS: Final = 8
"""Maximum number of programs that are watched by Groot2's protocol."""
WATCH_SECONDS: Final = 1.0
"""Time between two looks at the files, and at the users of the pages, s."""
ALIVE_SECONDS: Final = 2.0
"""Time between two events that tell pages that the server is there, s; a page takes longer silence for its end."""
LIST_RESTS: Final = 20.0
"""Times as long as the list of files took, until it is made again: a great folder is looked through less often."""
CHECK_SECONDS: Final = 0.08
"""Time without an edit after which a file is checked, s."""
USERS_SECONDS: Final = 0.5
"""Time without a check of a file with trees after which those that may use its trees are checked, s."""

_OWN: Final = frozenset(
    {'layout', 'revisions', 'text_at', 'compared', 'watch', 'past', 'reached', 'tree_log', 'groot2'}
)

_LOGGER: Final = logging.getLogger(__name__)


class Sessions:
    """All open pages. They share a workbench, which is used on one thread."""

    def __init__(
        self,
        workbench: Workbench,
        access: Access,
        recordings: Recordings,
        robots: FleetLink | None = None,
        programs: Sequence[str] = (),
    ) -> None:
        """``programs`` are the names of programs that can be watched by Groot2's protocol."""
        self._workbench = workbench
        self._recordings = recordings
        self._access = access
        self._simulation: Simulation | None = None
        self._ending = asyncio.Lock()
        self._robots = robots
        self._live: LiveRobots | None = None
        self._groot2: dict[str, Groot2Robot] = {}
        self._programs = programs
        self._pages: set[Page] = set()
        self._thread = ThreadPoolExecutor(1, 'workbench')
        self._drawing = ThreadPoolExecutor(1, 'drawing')
        self._checking = ThreadPoolExecutor(1, 'checking')
        self._checker = MachineChecks()
        self._layouts = Layouts()
        self._drawing.submit(self._layouts.start)  # while the page is loaded
        self._checks: dict[str, asyncio.Task[None]] = {}
        self._checking_users: asyncio.Task[None] | None = None
        self._numbers = count(1)
        self._instance = secrets.token_hex(8)
        """What tells pages that the server, and with it what is not saved, is another one."""
        self._jobs = Jobs(self.tell)
        self._watching: asyncio.Task[None] | None = None
        self._beating: asyncio.Task[None] | None = None

    async def close(self) -> None:
        """Cancel what is waiting, and end all jobs."""
        waiting = [*self._checks.values(), *filter(None, (self._watching, self._beating, self._checking_users))]
        for one in waiting:
            one.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)
        await self._jobs.close()
        if self._live is not None:
            await self._live.close()
        await asyncio.gather(*(one.close() for one in self._groot2.values()), self._end_simulation())
        self._thread.shutdown(wait=False, cancel_futures=True)
        self._drawing.shutdown(wait=False, cancel_futures=True)
        self._layouts.close()
        self._checking.shutdown(wait=False, cancel_futures=True)
        self._checker.close()

    async def serve(self, socket: web.WebSocketResponse, admitted: Callable[[], bool]) -> None:
        """Answer the requests of a page, which has sent the token, until it ends or its user is not ``admitted``."""
        self._watching = self._watching or asyncio.create_task(self._look_about())
        self._beating = self._beating or asyncio.create_task(self._beat())
        page = Page(socket, next(self._numbers), admitted)
        self._pages.add(page)
        try:
            await self._hear(page)
        finally:
            self._pages.discard(page)
            for number in page.jobs:
                self._jobs.cancel(number)
            for file in page.logs.difference(*(one.logs for one in self._pages)):
                await self._work(self._workbench.project.forget, file)
            if page.simulation is not None:
                await self._end_simulation(page.simulation)
            self.tell({'event': 'pages', 'count': len(self._pages)})

    async def _hear(self, page: Page) -> None:
        has_robots = self._robots is not None or bool(self._programs)
        welcome = {'event': 'welcome', 'page': page.number, 'instance': self._instance, 'robots': has_robots}
        await page.send({**welcome, 'folder': str(self._workbench.project.root)})
        self.tell({'event': 'pages', 'count': len(self._pages)})
        waiting: set[asyncio.Task[None]] = set()
        async for message in page.socket:
            if message.type is not WSMsgType.TEXT or not page.admitted():
                break
            number, method, arguments = _asked(message.data)
            if method in ('open', 'create', 'import_models'):  # before it is done: until then nobody uses the file
                page.files.add(str(arguments.get('file')))
            elif method == 'leave':
                page.files.discard(str(arguments.get('file')))
            if len(waiting) >= MOST_WAITING:
                told = f'{MOST_WAITING} requests of this page are waiting for their answers; ask again later'
                await page.send({'id': number, 'error': {'kind': 'busy', 'message': told}})
                continue
            task = asyncio.create_task(self._answer(page, number, method, arguments))
            waiting.add(task)
            task.add_done_callback(waiting.discard)
        await asyncio.sleep(0)  # what has arrived begins
        for task in waiting:
            task.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)

    async def _answer(self, page: Page, number: Any, method: str, arguments: dict[str, Any]) -> None:
        try:
            if not method:
                raise StudioError('a request is {"id": …, "method": "…", "arguments": {…}}')
            result = await self._result(page, method, arguments)
            answer: dict[str, Any] = {'id': number, 'result': result}
        except StudioError as error:
            answer = {'id': number, 'error': {'kind': _kind(error), 'message': str(error)}}
        except Exception as error:  # an internal fault: the user sees it, and goes on
            _LOGGER.exception('fault in a request of the page')
            told = one_line(traceback.format_exception_only(error)[-1].rstrip())
            answer = {'id': number, 'error': {'kind': 'fault', 'message': f'internal fault of the studio: {told}'}}
        if 'result' in answer:  # first, so that all pages are told of edits in their order
            self._follow(page, method, arguments, answer['result'])
        with contextlib.suppress(ConnectionError, TimeoutError):
            await page.send(answer)

    async def _start_job(self, page: Page, arguments: dict[str, Any]) -> dict[str, Any]:
        try:
            job, file, version = arguments['job'], arguments['file'], arguments['version']
            if str(file).endswith('.py') and not page.runs_code:
                raise StudioError(f'{file}: this would run its code, which nobody has allowed in this page')
            if job == 'decide':
                name = str(arguments['recording'])
                copy = await self._work(decide_copy, self._workbench.project, self._recordings, file, name)
            else:
                copy = await self._work(
                    partial(self._workbench.job_copy, **{k: v for k, v in arguments.items() if k != 'version'})
                )
        except (KeyError, TypeError) as error:
            raise StudioError(f'start_job: wrong arguments: {error}') from error
        return self._jobs.start(job, file, version, copy)

    async def _result(self, page: Page, method: str, arguments: dict[str, Any]) -> Any:
        """Return the result of a request. Those of the workbench, which only read and edit texts, come last.

        Git may be slow, and so a large picture or recording: that is done on other threads. Raises StudioError.
        """
        workbench, path, apart = self._workbench, self._workbench.project.path, asyncio.to_thread
        match method, arguments:
            case 'start_job', _:
                started = await self._start_job(page, arguments)
                page.jobs.append(started['number'])
                return started
            case 'leave', _:
                return None
            case 'cancel_job', _:
                return self._jobs.cancel(arguments.get('number', 0))
            case 'allow_code', _:
                page.runs_code = True
                for file in await self._work(lambda: list(workbench.project.open_files)):
                    self._check_soon(file)
                return True
            case 'layout', {'file': str(file), 'folded': list(folded)}:
                return await self._drawn(self._layouts.machine, await self._work(workbench.states, file), folded)
            case 'revisions', {'file': str(file)}:
                return await apart(revisions, path(file))
            case 'text_at', {'file': str(file), 'revision': str(revision), 'name': str(name)}:
                return await apart(text_at, path(file), revision, name)
            case 'compared', {'file': str(file), 'before': str(before), 'after': str(after)}:
                found = await self._drawn(workbench.compared, file, before, after)
                states = found['view'].get('states', [])
                return {**found, 'layout': await self._drawn(self._layouts.machine, states, []) if states else None}
            case 'watch', {'robot': str(name)}:
                return await self._watch(name)
            case 'past', {'robot': str(name)}:
                return await past_answer(await self._past(name), arguments)
            case 'recordings', _:
                return await apart(self._recordings.names)
            case 'reached', {'name': str(name)}:
                return await apart(lambda: opened(self._recordings, name).reached())
            case 'tree_log', {'name': str(name)}:
                file, text, played = await apart(log_of, self._recordings, name)
                page.logs.add(file)
                await self._show_text(file, text)
                return played
            case 'groot2', {'robot': str(name), 'do': str(line)}:
                if name not in self._groot2:
                    raise StudioError(f'there is no such program: {short_repr(name)}; watch it first')
                return await self._groot2[name].command(line)
        if method.startswith('simulator_'):
            return await self._simulate(page, method, arguments)
        if method in _OWN:
            raise StudioError(f'{method}: wrong arguments')
        return await self._done(page, method, arguments)

    async def _done(self, page: Page, method: str, arguments: dict[str, Any]) -> Any:
        """Return the result of a request of the workbench. If the page ends meanwhile, the others are told of it."""
        answer = partial(self._workbench.answer, method, arguments)
        doing = asyncio.get_running_loop().run_in_executor(self._thread, answer)

        def follow(done: asyncio.Future[Any]) -> None:
            if not done.cancelled() and done.exception() is None:
                self._follow(page, method, arguments, done.result())

        try:
            return await asyncio.shield(doing)
        except asyncio.CancelledError:
            doing.add_done_callback(follow)
            raise

    async def _drawn(self, function: Any, *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._drawing, function, *arguments)

    async def _past(self, name: str) -> Past | None:
        """Return the past of a robot that is watched, or a recording; None without. Raises StudioError."""
        if name.startswith(RECORDING):
            return await asyncio.to_thread(opened, self._recordings, name)
        if name == SIMULATION and self._simulation is not None:
            return self._simulation.past()
        return None if self._live is None else self._live.past(name)

    async def _watch(self, name: str) -> str:
        """Show what runs on a robot by events ``live``, and return its name. Raises StudioError if there is none.

        ``groot2 HOST:PORT`` is a program at that address, ``recording NAME`` a recording, which sends no events.
        Without a name it is the own robot, or else such a program.
        """
        if name.startswith(RECORDING):
            await self._past(name)
            return name
        if not name and self._robots is None:
            name = next(iter((*self._programs, *self._groot2)), '')
        if name == SIMULATION and self._simulation is not None:
            return await self._simulation.watch()
        if name.startswith(PREFIX):
            return self._watch_groot2(robot_name(name.removeprefix(PREFIX)))
        if self._robots is None:
            raise StudioError('no robots are watched: start the studio by studio --operate, or console web --studio')
        if self._live is None:
            self._live = LiveRobots(self._robots, self.tell)
        return await self._live.watch(name)

    async def simulator_page(self, request: web.Request) -> web.StreamResponse:
        """Answer a request of the operator's page of the simulated robot."""
        if self._simulation is None:
            raise web.HTTPNotFound(text='there is no simulated robot')
        return await self._simulation.page(request)

    async def _simulate(self, page: Page, method: str, arguments: dict[str, Any]) -> Any:
        """Answer a request about the simulated robot. It ends with the page that has started it."""
        simulation, workbench = self._simulation, self._workbench
        match method.removeprefix('simulator_'), arguments:
            case 'worlds', _:
                return await self._work(lambda: list(worlds(workbench.project)))
            case 'state', _:
                return simulation.state if simulation is not None else None
            case 'start', {'world': str(world), 'speed': int() | float() as speed}:
                paths = await self._work(worlds, workbench.project)
                if world not in ('', *paths):
                    raise StudioError(f'there is no world {short_repr(world)}{did_you_mean(world, list(paths))}')
                return await self._start_simulation(page, paths.get(world, ''), float(speed))
            case 'stop', _:
                await self._end_simulation()
                return None
            case 'run' | 'cancel' | 'what_if', _ if simulation is None:
                raise StudioError('there is no simulated robot; start it')
            case 'run', {'file': str(file), 'tree': str(tree), 'goal': str(goal)} if simulation is not None:
                simulation.write_project(await self._work(project_files, workbench.project))
                if not file.endswith('.xml'):
                    if file.endswith('.py') and not page.runs_code:
                        raise StudioError(f'{file}: this would run its code, which nobody has allowed in this page')
                    return await simulation.run_behavior(*await self._work(behavior_files, workbench.project, file))
                return await simulation.run_tree(await self._work(workbench.tree_texts, file), tree, goal)
            case 'cancel', _ if simulation is not None:
                return await simulation.stop()
            case (
                'what_if',
                {'fault': str(fault), 'entity': str(entity), 'parameters': dict(more), 'clear': bool(ends)},
            ) if simulation is not None:
                return await simulation.what_if(fault, entity, more, clear=ends)
        raise StudioError(f'{short_repr(method)}: there is no such request, or its arguments are wrong')

    async def _start_simulation(self, page: Page, world: str, speed: float) -> None:
        if self._simulation is not None and self._simulation.is_over:
            await self._end_simulation()
        if self._simulation is not None:
            raise StudioError('a simulated robot runs already; stop it first')
        self._simulation = simulation = Simulation(self._access, self.tell, is_alone=self._robots is None)
        page.simulation = simulation
        try:
            await simulation.start(world, speed)
        except BaseException:
            await self._end_simulation(simulation)
            raise

    async def _end_simulation(self, of: Simulation | None = None) -> None:
        """End the simulated robot, or only this one. Its processes are gone when this returns."""
        async with self._ending:
            simulation = self._simulation
            if simulation is not None and of in (None, simulation):
                self._simulation = None
                await simulation.close()

    def _watch_groot2(self, name: str) -> str:
        if name not in self._groot2:
            if len(self._groot2) >= MOST_PROGRAMS:
                raise StudioError(f'{MOST_PROGRAMS} programs are watched already; start the studio again for others')
            self._groot2[name] = Groot2Robot(name, self.tell, self._show_text)
        self._groot2[name].show_again()
        return name

    async def _show_text(self, file: str, text: str) -> None:
        """Show a text that cannot be edited, also to the pages that show an older one of this name."""
        await self._work(self._workbench.project.show, file, text)
        self.tell({'event': 'files_changed', 'file': file, 'what': 'close', 'by': 0})

    def _follow(self, page: Page, method: str, arguments: dict[str, Any], result: Any) -> None:
        """Tell the pages what a request has changed, and check what was opened or edited."""
        file = str(arguments.get('file', ''))
        if method == 'open' and file.startswith(RECORDING):
            page.logs.add(file)
        if method == 'edit':
            event = {'event': 'edited', 'file': file, 'version': result, 'edits': arguments['edits'], 'by': page.number}
            self.tell({**event, 'key': arguments.get('key', '')}, but=page)
        if method in ('edit', 'open', 'create', 'save'):
            self._check_soon(file)
        if method in ('create', 'save', 'close') or (method == 'take_disk' and result is not None):
            event = {'event': 'files_changed', 'file': file, 'what': method, 'by': page.number}
            more = {'save': {'version': arguments.get('version')}, 'take_disk': {'saved': result}}
            self.tell({**event, **more.get(method, {})})

    async def _beat(self) -> None:
        """Tell the pages that the server is there, also while the workbench is busy."""
        while True:
            await asyncio.sleep(ALIVE_SECONDS)
            self.tell({'event': 'alive'})

    async def _look_about(self) -> None:
        """Tell the pages about files that other programs write, and end those whose users were removed."""
        clock = asyncio.get_running_loop().time
        known, due = await self._work(self._workbench.project.files), 0.0
        while True:
            await asyncio.sleep(WATCH_SECONDS)
            for page in [one for one in self._pages if not one.admitted()]:
                page.end(WSCloseCode.POLICY_VIOLATION, b'the user was removed')
            used = {file for page in self._pages for file in page.files}
            await self._work(self._workbench.project.leave, used)
            for file in await self._work(self._workbench.project.disk_changes):
                self.tell({'event': 'disk', 'file': file})
            if self._pages and (began := clock()) >= due:
                files = await self._work(self._workbench.project.files)
                due = clock() + LIST_RESTS * (clock() - began)
                written = await self._work(self._workbench.project.written)
                for file in written:
                    self.tell({'event': 'disk', 'file': file})
                    self._check_users_soon(file)
                if written or files != known:
                    self.tell({'event': 'files_changed', 'file': '', 'what': 'disk', 'by': 0})
                known = files

    def _check_soon(self, file: str) -> None:
        running = self._checks.pop(file, None)
        if running is not None:
            running.cancel()
        self._checks[file] = asyncio.create_task(self._check(file))

    async def _check(self, file: str) -> None:
        """Check a file after a pause, if it is open, and send its graph and its findings to all pages."""
        await asyncio.sleep(CHECK_SECONDS)

        def of_open(function: Callable[..., Any], *arguments: Any) -> Any:
            if file not in self._workbench.project.open_files:
                raise ConflictError(f'{file} was closed')
            return function(file, *arguments)

        try:
            model = await self._work(of_open, self._workbench.model)
            model.pop('text')
            self.tell({'event': 'model', **model})
            question = await self._work(of_open, self._workbench.question)
            if question['language'] == 'yaml':
                found = await asyncio.get_running_loop().run_in_executor(self._checking, self._check_machine, question)
            elif file.endswith('.py') and not model['problems'] and any(page.runs_code for page in self._pages):
                version, name, copy = await self._work(of_open, self._workbench.check_copy)
                found = await self._work(of_open, self._workbench.located, version, name, await checked(copy))
            else:
                found = await self._work(of_open, self._workbench.checked)
            self.tell({'event': 'findings', 'file': file, **found})
            if question['language'] == 'xml':
                self._check_users_soon(file)
        except ConflictError:
            pass  # it was closed, or a check of the new text follows
        except StudioError as error:
            self.tell({'event': 'note', 'file': file, 'message': str(error)})
        except Exception as error:  # a fault of a checker: the user sees it
            _LOGGER.exception('fault in the check of %s', file)
            self.tell(
                {'event': 'note', 'file': file, 'message': f'internal fault of the checker: {one_line(str(error))}'}
            )

    def _check_users_soon(self, file: str) -> None:
        if self._checking_users is not None:
            self._checking_users.cancel()
        self._checking_users = asyncio.create_task(self._check_users(file))

    async def _check_users(self, file: str) -> None:
        """Check the open files that may use the trees of a file, after a pause, and send their findings."""
        await asyncio.sleep(USERS_SECONDS)
        for other in await self._work(self._workbench.users, file):
            with contextlib.suppress(StudioError):
                found = await self._work(self._workbench.checked, other)
                self.tell({'event': 'findings', 'file': other, **found})

    def _check_machine(self, question: dict[str, Any]) -> dict[str, Any]:
        """Return the findings for a machine. On a thread of its own. Raises StudioError."""
        found = self._checker.findings(question['root'], question['file'], question['text'])
        page = PageText(question['text'])
        return {'version': question['version'], 'findings': [shown_finding(asdict(one), page) for one in found]}

    async def _work(self, function: Any, *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._thread, partial(function, *arguments))

    def tell(self, event: dict[str, Any], but: Page | None = None) -> None:
        """Send an event to all pages, or to all others than ``but``. On the thread of the loop."""
        for page in self._pages:
            if page is not but:
                page.post(event)


class Page:
    """The connection of an open page."""

    def __init__(self, socket: web.WebSocketResponse, number: int, admitted: Callable[[], bool]) -> None:
        self.socket = socket
        self.number = number
        self.admitted = admitted
        """Returns whether its user still may use the studio."""
        self.runs_code = False
        """Whether the user has allowed to run the code of behaviors in Python."""
        self.simulation: Simulation | None = None
        """The simulated robot that it has started; it ends with the page."""
        self.jobs: list[int] = []
        """Numbers of the jobs that it has started; they end with it."""
        self.files: set[str] = set()
        """Files that it has open; what no page has open and is not edited is forgotten."""
        self.logs: set[str] = set()
        """Trees of logs that it has opened; each is forgotten with the last page that has."""
        self._sending = asyncio.Lock()
        self._posted: set[asyncio.Task[None]] = set()

    async def send(self, message: dict[str, Any]) -> None:
        """Send a message; messages arrive in the order of the calls. Raises ConnectionError and TimeoutError."""
        async with self._sending:
            await asyncio.wait_for(self.socket.send_str(json.dumps(message, separators=(',', ':'))), SEND_SECONDS)

    def post(self, event: dict[str, Any]) -> None:
        """Send an event without waiting. A page that takes nothing is closed."""
        self._start(self._deliver(event))

    def end(self, code: int, reason: bytes) -> None:
        """Close the connection without waiting."""
        self._start(self.socket.close(code=code, message=reason))

    def _start(self, doing: Coroutine[Any, Any, Any]) -> None:
        task = asyncio.create_task(doing)
        self._posted.add(task)
        task.add_done_callback(self._posted.discard)

    async def _deliver(self, event: dict[str, Any]) -> None:
        try:
            await self.send(event)
        except (ConnectionError, TimeoutError):
            await self.socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b'the page takes nothing')


def _asked(text: str) -> tuple[Any, str, dict[str, Any]]:
    """Return identifier, method and arguments of a request; '' for the method if it is none."""
    match _loaded(text):
        case {'id': number, 'method': str(method), 'arguments': dict(arguments)}:
            return number, method, arguments
        case {'id': number, 'method': str(method), **more} if 'arguments' not in more:
            return number, method, {}
        case {'id': number}:
            return number, '', {}
    return None, '', {}


def _loaded(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def _kind(error: StudioError) -> str:
    return {ConflictError: 'conflict', GestureError: 'gesture'}.get(type(error), 'refused')
