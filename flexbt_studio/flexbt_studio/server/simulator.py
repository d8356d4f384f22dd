# SPDX-License-Identifier: BSD-3-Clause
"""A simulated robot that runs the open files: its processes, on a ROS domain of its own, and its operator's page.

The processes are the simulator with navigation, BT server, stop guard and executive. They end with the studio, even if
that is killed. What they need of the project is copied as it is open: files as those of an installed package, and the
behavior that is run.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import tempfile
from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import yaml
from aiohttp import web

from flexbt_core.values.text import did_you_mean, one_line, short_repr
from flexbt_core.values.text_files import TextFileError, read_text
from flexbt_studio.documents.project import Project
from flexbt_studio.errors import StudioError
from flexbt_studio.tool_process import behavior_copy

from .jobs import Tell
from .live import LiveRobots

if TYPE_CHECKING:
    from flexbt_common.runtime.node_runtime import NodeRuntime
    from flexbt_console.link.fleet_link import FleetLink
    from flexbt_console.ui.web.access import Access
    from flexbt_console.ui.web.past import LivePast
    from flexbt_console.ui.web.server import WebServer

NAME: Final = 'simulation'
"""Name of the simulated robot among those that are watched."""
SPEEDS: Final = (0.1, 100.0)
"""Least and greatest number of simulated seconds in a second."""
START_SECONDS: Final = 120.0
"""Time until the robot is there, s."""
END_SECONDS: Final = 2.0
"""Time for the processes to end when they are asked to, s; then they are killed."""
ANSWER_SECONDS: Final = 10.0
"""Time for an answer of the simulator or the BT server, s."""
WORLD_BYTES: Final = 1_000_000
ODOM_RATE: Final = 20.0
"""Rate of poses in simulated time, Hz."""
_WORLD: Final = re.compile(r'^(?:robots|plan)\s*:', re.MULTILINE)
_PACKAGE: Final = 'flexbt_studio_run'
"""Package of the behavior that is run."""
_GROUP: Final = 'flexbt.behaviors'
_LAST_LINES: Final = 5


def worlds(project: Project) -> dict[str, str]:
    """Return the paths of world files by their names: those of the project, and of installed packages."""
    from ament_index_python.packages import get_packages_with_prefixes

    found = {name: str(project.root / name) for name, text in project.texts_with({'.yaml'}) if _WORLD.search(text)}
    for package, prefix in sorted(get_packages_with_prefixes().items()):
        share = Path(prefix, 'share', package)
        for path in sorted([*share.glob('*.yaml'), *share.glob('*/*.yaml')]):
            with contextlib.suppress(TextFileError):
                if _WORLD.search(read_text(path, WORLD_BYTES)):
                    found[f'{package}/{path.relative_to(share).as_posix()}'] = str(path)
    return found


def project_files(project: Project) -> dict[str, str]:
    """Return the data of the project as files of its installed package, by their paths below a prefix.

    A package installs its folders, or those of the Python package of its name.
    """
    package = project.root.name
    for folder in (project.root, project.root.parent):
        with contextlib.suppress(TextFileError):
            named = re.search(r'<name>\s*([\w-]+)\s*</name>', read_text(folder / 'package.xml', WORLD_BYTES))
            package = named[1] if named else package
            break
    files = {f'share/ament_index/resource_index/packages/{package}': ''}
    for name, text in project.texts_with({'.xml', '.yaml', '.yml'}):
        for place in {name, name.removeprefix(f'{package}/')}:
            files[f'share/{package}/{place}'] = text
    return files


def behavior_files(project: Project, file: str) -> tuple[dict[str, str], str]:
    """Return the files of a behavior by their paths below a prefix, and its name. Raises StudioError."""
    document = project.open(file).document
    behavior = document.view().get('behavior') or {}
    if document.language == 'python':
        own, copied, _ = behavior_copy(project, file)
        files = {f'python/{name}': text for name, text in copied.items()}
        value = f'{own.removesuffix(".py").replace("/", ".")}:{behavior.get("class", "")}'
        entry = str(behavior.get('class', ''))
    else:
        entry = re.sub(r'[^\w.-]', '_', Path(file).stem)
        files = {f'python/{_PACKAGE}/__init__.py': '', f'python/{_PACKAGE}/{entry}.yaml': document.text}
        value = f'{_PACKAGE}:{entry}.yaml'
    if not any(point.value == value for point in entry_points(group=_GROUP)):
        metadata = f'python/{_PACKAGE}-0.dist-info'
        files[f'{metadata}/METADATA'] = f'Metadata-Version: 2.1\nName: {_PACKAGE}\nVersion: 0\n'
        files[f'{metadata}/entry_points.txt'] = f'[{_GROUP}]\n{entry} = {value}\n'
    return files, str(behavior.get('name') or entry)


class Simulation:
    """A simulated robot. Used on the thread of the loop. ``tell`` sends an event to all pages.

    Pages are told events ``simulator`` with a ``state``: starting, running, or ended, with a ``message``.
    """

    def __init__(self, access: Access, tell: Tell, *, is_alone: bool) -> None:
        """``is_alone``: this process has no other robots, so that its profile of the network can be chosen."""
        self._access = access
        self._is_alone = is_alone
        self._tell = tell
        self._folder = tempfile.TemporaryDirectory(prefix='flexbt_simulation_', ignore_cleanup_errors=True)
        self._things = contextlib.AsyncExitStack()
        self._environment: dict[str, str] = {}
        self._processes: dict[str, asyncio.subprocess.Process] = {}
        self._commands: dict[str, list[str]] = {}
        self._watchers: set[asyncio.Task[None]] = set()
        self._state: dict[str, Any] = {'event': 'simulator', 'state': 'ended', 'message': ''}
        self._runtime: NodeRuntime | None = None
        self._robots: FleetLink | None = None
        self._live: LiveRobots | None = None
        self._server: WebServer | None = None
        self._robot = '/'
        self._pages: set[asyncio.Future[web.StreamResponse]] = set()
        self._run: Any = None
        self._closing: asyncio.Task[None] | None = None
        self._busy = asyncio.Lock()
        """Held while processes are started or ended."""
        self.is_over = False
        """Whether it has ended, or ends."""

    @property
    def state(self) -> dict[str, Any]:
        """The last event."""
        return self._state

    async def start(self, world: str, speed: float) -> None:
        """Start the robot in the world of a file, or on the built-in map without one. Raises StudioError."""
        low, high = SPEEDS
        if not low <= speed <= high:
            raise StudioError(f'speed {speed:g}: write a number of simulated seconds in a second, {low:g} to {high:g}')
        content = _content(world) if world else {}
        robots, doors = _names(content, 'robots'), _names(content, 'doors')
        namespace = f'/{robots[0]}' if len(robots) > 1 else ''
        self._robot = namespace or '/'
        self._set({'state': 'starting', 'doors': doors, 'robots': robots, 'speed': speed})
        try:
            async with self._busy:
                await self._begin(world, speed, namespace, content.get('places'))
        except (ImportError, LookupError, OSError, RuntimeError) as error:
            raise StudioError(f'the simulator cannot be started: {one_line(str(error), 500)}') from error
        waiting = asyncio.create_task(self._wait())
        self._watchers.add(waiting)

    async def _begin(self, world: str, speed: float, namespace: str, places: Any) -> None:
        from ament_index_python.packages import get_package_prefix, get_package_share_directory

        from flexbt_common import discovery
        from flexbt_common.domains import reserved_domain

        folder = Path(self._folder.name)
        domain = self._things.enter_context(reserved_domain())
        network = {'ROS_DOMAIN_ID': str(domain)}
        if not self._is_alone and Path(os.environ.get(discovery.PROFILE, '')) != discovery.profile('this_computer'):
            network |= {discovery.RANGE: 'LOCALHOST'}  # another profile is in use here
        else:
            discovery.only_this_computer(network)
        path = {name: f'{folder / inner}:{os.environ.get(name, "")}' for name, inner in _PATHS.items()}
        own = {name: value for name, value in os.environ.items() if name != discovery.PROFILE}
        self._environment = {**own, **network, **path, 'OMP_NUM_THREADS': '1'}
        known = folder / 'places.yaml'
        if isinstance(places, dict) and all(isinstance(pose, list) for pose in places.values()):
            poses = {str(name): dict(zip(('x', 'y', 'yaw'), pose, strict=False)) for name, pose in places.items()}
            known.write_text(yaml.safe_dump(poses))
        elif not world:
            known = Path(get_package_share_directory('flexbt_sim'), 'maps', 'rooms_places.yaml')
        simulated = {'use_sim_time': True}
        in_world = {'world': world, 'robot_namespaces': bool(namespace)} if world else {}
        kept = {'event_log_directory': str(folder / 'log'), 'machine_directory': ''}
        table: list[tuple[str, str, str, dict[str, Any]]] = [
            ('flexbt_navigation', 'simulation', '', {'speed_factor': speed, 'odom_rate': ODOM_RATE, **in_world}),
            ('flexbt_server', 'bt_server', namespace, {**simulated, 'allowed_directories': [str(folder / 'trees')]}),
            ('flexbt_onboard', 'stop_guard', namespace, {}),
            ('flexbt_onboard', 'onboard_executive', namespace, {**simulated, 'places': str(known), **kept}),
        ]
        if not (known.exists()):
            del table[-1][3]['places']
        for package, executable, space, parameters in table:
            words = [str(Path(get_package_prefix(package), 'lib', package, executable)), '--ros-args']
            words += ['-r', f'__ns:={space}'] if space else []
            words += [word for key, value in parameters.items() for word in ('-p', f'{key}:={json.dumps(value)}')]
            self._commands[executable] = words
            await self._launch(executable)
        with _changed_environment(network):
            self._runtime = await asyncio.to_thread(_runtime)
        self._things.push_async_callback(asyncio.to_thread, self._runtime.close)
        await self._connect(self._runtime)

    async def _launch(self, name: str) -> None:
        if self.is_over:
            raise StudioError('the simulated robot was stopped')
        log = Path(self._folder.name, f'{name}.log')
        ending = shutil.which('setpriv')  # the kernel ends it with the studio, however that ends
        words = [*([ending, '--pdeathsig', 'KILL', '--'] if ending else []), *self._commands[name]]
        with log.open('ab') as output:
            process = await asyncio.create_subprocess_exec(
                *words,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=output,
                stderr=asyncio.subprocess.STDOUT,
                env=self._environment,
                start_new_session=True,
            )
        self._processes[name] = process
        watcher = asyncio.create_task(self._watch_process(name, process, log))
        self._watchers.add(watcher)
        watcher.add_done_callback(self._watchers.discard)

    async def _watch_process(self, name: str, process: asyncio.subprocess.Process, log: Path) -> None:
        code = await process.wait()
        if self._processes.get(name) is process:
            last = ' / '.join(log.read_text(errors='replace').splitlines()[-_LAST_LINES:])
            self._fail(f'{name} has ended with code {code}: {one_line(last, 800)}')

    async def _connect(self, runtime: NodeRuntime) -> None:
        """Serve the operator's page of the robot, and show what runs on it."""
        from flexbt_console.commands.command_builder import CommandBuilder
        from flexbt_console.commands.effects import SCAN_PERIOD
        from flexbt_console.link.fleet_link import FleetLink
        from flexbt_console.link.robot_link import RobotLink
        from flexbt_console.link.simulator_link import SimulatorLink
        from flexbt_console.mirror.fleet import Fleet
        from flexbt_console.mirror.mirror import Mirror
        from flexbt_console.ui.station import Attention, Station
        from flexbt_console.ui.web.server import WebServer

        simulator, attention = SimulatorLink(runtime), Attention(runtime.steady)

        def station(mirror: Mirror, link: RobotLink, name: str) -> Station:
            leaving = 'close the page: the simulated robot continues'
            builder = CommandBuilder(name or NAME)
            return Station(mirror, link, builder, ANSWER_SECONDS, attention, leaving, obstacles=simulator)

        def mirror() -> Mirror:
            return Mirror(runtime.steady)

        self._robots = await asyncio.to_thread(
            lambda: FleetLink(runtime, Fleet(), mirror, NAME, SCAN_PERIOD, [self._robot])
        )
        self._live = LiveRobots(self._robots, lambda event: self._tell({**event, 'robot': NAME}))
        self._things.push_async_callback(self._live.close)
        self._server = WebServer(self._robots, station, self._access, lambda name: name)
        await self._server.start()
        self._things.push_async_callback(self._server.end)

    async def _wait(self) -> None:
        """Tell when the robot is there."""
        try:
            async with asyncio.timeout(START_SECONDS):
                while not self._is_ready():
                    await asyncio.sleep(0.2)
            if not self.is_over:  # what was heard last may be of before
                self._set({'state': 'running', 'message': ''})
        except TimeoutError:
            self._fail(f'the robot was not there within {START_SECONDS:g} s')

    def _is_ready(self) -> bool:
        assert self._robots is not None
        snapshot = self._robots.robot(self._robot)[0].view().snapshot
        there = (
            {peer.name.rpartition('/')[2] for peer in snapshot.peers if peer.alive and peer.ready} if snapshot else ()
        )
        return {'bt_server', 'navigation', 'simulator', 'stop_guard'} <= set(there)

    def _fail(self, message: str) -> None:
        """Tell why the robot ends, and end what is left of it. What happens after that is no reason."""
        if self.is_over:
            return
        self._set({'state': 'ended', 'message': message})
        self._closing = asyncio.create_task(self.close())

    async def close(self) -> None:
        """End the robot: its processes are gone when this returns."""
        self.is_over = True
        async with self._busy:
            await self._close()

    async def _close(self) -> None:
        processes, self._processes = self._processes, {}
        ended = asyncio.gather(*(process.wait() for process in processes.values()))
        for number in (signal.SIGINT, signal.SIGKILL):
            for process in processes.values():
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, number)
            await asyncio.wait([ended], timeout=END_SECONDS)
        ending: list[asyncio.Future[Any]] = [*self._watchers, *self._pages]
        for one in ending:
            one.cancel()
        await asyncio.gather(*ending, return_exceptions=True)
        await ended
        await self._things.aclose()
        self._folder.cleanup()
        if self._state['state'] != 'ended':
            self._set({'state': 'ended', 'message': ''})

    def _set(self, changes: Mapping[str, Any]) -> None:
        self.is_over = self.is_over or changes.get('state') == 'ended'
        self._state = {**self._state, **changes}
        self._tell(self._state)

    # Requests of pages.

    async def watch(self) -> str:
        """Show what runs on the robot by events ``live``, and return its name."""
        await self._there().watch(self._robot)
        return NAME

    def past(self) -> LivePast | None:
        """Return the past of the robot."""
        return self._there().past(self._robot)

    def _there(self) -> LiveRobots:
        if self._live is None or self.is_over:
            raise StudioError('the simulated robot is not there; start it')
        return self._live

    async def page(self, request: web.Request) -> web.StreamResponse:
        """Answer a request of the operator's page of this robot."""
        if self._server is None:
            raise web.HTTPNotFound(text='the simulated robot is starting')
        links = {'link': self._server.open_page, 'costmaps': self._server.open_costmaps}
        name = request.match_info['name']
        if name not in links:
            return await self._server.file(request)
        opened = asyncio.ensure_future(links[name](request))
        self._pages.add(opened)
        opened.add_done_callback(self._pages.discard)
        return await opened

    async def run_tree(self, files: Mapping[str, str], tree: str, goal: str) -> None:
        """Run a tree of ``files`` (texts by name). ``goal`` is a place, or x, y and yaw (m, rad); '' for none.

        Its result is told as a note. Raises StudioError if it cannot be loaded or run.
        """
        from flexbt_common import names
        from flexbt_msgs.action import BtExecute, BtLoad

        self._there()
        folder = Path(self._folder.name, 'trees')
        self.write_project({f'trees/{name}': text for name, text in files.items()})
        loaded = await self._act(BtLoad, names.BT_LOADER, BtLoad.Goal(files=[str(folder / name) for name in files]))
        if loaded.code != BtLoad.Result.SUCCESS:
            raise StudioError(loaded.message.replace(f'{folder}/', ''))
        await self.stop()
        wanted = BtExecute.Goal(behavior_tree=tree, goals=self._goals(goal), blackboard=NAME)
        running = asyncio.ensure_future(self._act(BtExecute, names.BT_EXECUTOR, wanted, keeps=True))

        def ended(done: asyncio.Future[Any]) -> None:
            error = None if done.cancelled() else done.exception()
            result = None if error or done.cancelled() else done.result()
            codes = {getattr(BtExecute.Result, one): one for one in ('SUCCESS', 'FAILURE', 'CANCELED', 'ERROR')}
            text = str(error) if result is None else f'{codes.get(result.code, "?")} {result.message}'
            self._tell({'event': 'note', 'message': f'Simulation: the tree {tree} has ended: {one_line(text, 500)}'})

        running.add_done_callback(ended)

    async def stop(self) -> None:
        """End the tree that was run last."""
        if self._run is not None:
            self._run.cancel()

    async def _act(self, type: Any, name: str, goal: Any, *, keeps: bool = False) -> Any:
        """Return the result of a goal for the BT server. Raises StudioError."""
        from concurrent.futures import Future

        from flexbt_common import names
        from flexbt_common.calls.action_call import ActionCall, ActionLinks, GoalOutcome

        assert self._runtime is not None
        done: Future[GoalOutcome] = Future()
        links, server = ActionLinks(self._runtime), names.of_robot(self._robot, name)
        link = await asyncio.to_thread(links.link, type, server)
        seconds = ANSWER_SECONDS
        call = ActionCall(link, goal, on_done=done.set_result, server_timeout=seconds, accept_timeout=seconds)
        if keeps:
            self._run = call
        outcome = await asyncio.wrap_future(done)
        if outcome.result is None:
            raise StudioError(f'the BT server of the simulated robot: {outcome.reason}')
        return outcome.result

    def _goals(self, goal: str) -> list[Any]:
        if not goal.strip():
            return []
        from flexbt_common.values.entries import text_to_value
        from flexbt_console.commands.operator_values import value_text
        from flexbt_console.errors import ConsoleError

        assert self._robots is not None
        places = self._robots.robot(self._robot)[0].view().places
        try:
            return [text_to_value(value_text(goal, _POSE, places), _POSE)]
        except ConsoleError as error:
            raise StudioError(f'the goal {short_repr(goal)}: {error}{did_you_mean(goal, list(places))}') from error

    async def run_behavior(self, files: Mapping[str, str], name: str) -> str:
        """Start the executive again with the files of a behavior, and return by which name it knows that."""
        self._there()
        assert self._robots is not None
        mirror = self._robots.robot(self._robot)[0]
        old = mirror.view().snapshot
        async with self._busy:
            before = self._processes.pop('onboard_executive', None)
            if before is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(before.pid, signal.SIGKILL)
                await before.wait()
            shutil.rmtree(Path(self._folder.name, 'python'), ignore_errors=True)
            self.write_project(files)
            await self._launch('onboard_executive')
        until = asyncio.get_running_loop().time() + START_SECONDS
        while True:
            view = mirror.view()
            is_new = view.snapshot is not None and (old is None or view.snapshot.executive_id != old.executive_id)
            if is_new and view.behaviors is not None and self._is_ready():
                break
            self._there()
            if asyncio.get_running_loop().time() > until:
                raise StudioError(f'the executive was not there within {START_SECONDS:g} s')
            await asyncio.sleep(0.1)
        known = [one.name for one in view.behaviors]
        found = next((one for one in (f'{_PACKAGE}/{name}', name) if one in known), None)
        if found is None:
            raise StudioError(f'the executive has no behavior {short_repr(name)}{did_you_mean(name, known)}')
        error = next(one.error for one in view.behaviors if one.name == found)
        if error:
            raise StudioError(f'the executive cannot run the behavior {short_repr(name)}: {one_line(error, 500)}')
        return shlex.quote(found)

    async def what_if(self, fault: str, entity: str, parameters: Mapping[str, Any], *, clear: bool = False) -> None:
        """Let a fault of the simulator begin, or end. Raises StudioError."""
        from flexbt_common.calls.service_call import ServiceLinks, service_outcome
        from flexbt_msgs.srv import SetFault

        self._there()
        request = SetFault.Request(entity=entity, fault=fault, parameters=json.dumps(parameters), clear=clear)
        assert self._runtime is not None
        link = await asyncio.to_thread(ServiceLinks(self._runtime).link, SetFault, '/simulator/set_fault')
        outcome = await asyncio.to_thread(service_outcome, link, request, ANSWER_SECONDS)
        if outcome.response is None or not outcome.response.success:
            why = outcome.reason if outcome.response is None else outcome.response.message
            raise StudioError(f'the simulator refuses: {one_line(why, 500)}')

    def write_project(self, files: Mapping[str, str]) -> None:
        """Write files of the copy of the project. Raises StudioError."""
        try:
            for name, text in files.items():
                path = Path(self._folder.name, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding='utf-8', newline='')
        except OSError as error:
            raise StudioError(f'the copy of the project cannot be written: {error}') from error


_PATHS: Final = {'PYTHONPATH': 'python', 'AMENT_PREFIX_PATH': '.'}
_POSE: Final = 'geometry_msgs/msg/PoseStamped'


def _content(world: str) -> dict[str, Any]:
    try:
        content = yaml.safe_load(read_text(Path(world), WORLD_BYTES))
    except (yaml.YAMLError, TextFileError, RecursionError) as error:
        raise StudioError(f'the world {world} cannot be read: {one_line(str(error), 300)}') from error
    return content if isinstance(content, dict) else {}


def _names(content: Mapping[str, Any], key: str) -> list[str]:
    found = content.get(key)
    return [str(name) for name in found] if isinstance(found, dict) else []


def _runtime() -> NodeRuntime:
    from flexbt_common.runtime.node_runtime import NodeRuntime

    return NodeRuntime('studio', args=['studio'])


@contextlib.contextmanager
def _changed_environment(changes: Mapping[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})
