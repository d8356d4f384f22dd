# SPDX-License-Identifier: BSD-3-Clause
"""The web server of the studio: its page, the text editor's modules, and a WebSocket for each open page."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import sys
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from aiohttp import WSCloseCode, web

from flexbt_common.files import home_directory
from flexbt_console.commands.spec import Role
from flexbt_console.errors import UsageError
from flexbt_console.ui.web.access import Access, guard
from flexbt_console.ui.web.greetings import Greetings
from flexbt_console.ui.web.page_files import PageFiles

from .recordings import recordings_of
from .session import MESSAGE_BYTES, Sessions
from .workbench import Workbench

if TYPE_CHECKING:
    from flexbt_console.link.fleet_link import FleetLink

PING_SECONDS: Final = 10.0
EDITOR_FOLDER: Final = 'FLEXBT_STUDIO_EDITOR'
"""Environment variable: the folder ``node_modules`` that has CodeMirror."""

_IMPORT_MAP: Final = '<!-- import map -->'


class StudioServer:
    """The server of the studio's pages for one project.

    ``robots`` are those that can be watched; ``programs`` the names of programs that can, by Groot2's protocol;
    ``recordings`` is their folder, see :func:`.recordings.recordings_of`.
    """

    def __init__(
        self,
        workbench: Workbench,
        access: Access,
        editor: Path | None,
        robots: FleetLink | None = None,
        programs: Sequence[str] = (),
        recordings: str = '',
    ) -> None:
        self._access = access
        self._greetings = Greetings(access)
        recorded = recordings_of(workbench.project, recordings)
        self._sessions = Sessions(workbench, access, recorded, robots, programs)
        self._modules = {} if editor is None else editor_modules(editor)
        shared, own = files('flexbt_console.ui.web') / 'page', files('flexbt_studio') / 'page'
        self._files = PageFiles(shared, own, page='studio.html')
        self._files.images = "'self' data:"
        import_map = json.dumps({'imports': {name: f'./modules/{name}' for name in self._modules}})
        script = f'<script type="importmap">{import_map}</script>' if self._modules else ''
        self._files.add('', self._files.text('').replace(_IMPORT_MAP, script).encode(), 'html')
        if self._modules:
            digest = base64.b64encode(hashlib.sha256(import_map.encode()).digest()).decode()
            self._files.scripts = f"'self' 'sha256-{digest}'"

    def application(self) -> web.Application:
        """Return a new aiohttp application that serves the page."""
        application = web.Application(middlewares=[guard(self._access)], client_max_size=0)
        application.on_cleanup.append(self._end)
        application.router.add_get('/session', self._open)
        application.router.add_get('/modules/{name:[a-z0-9@/-]+}', self._module)
        application.router.add_get('/simulator/{name:[a-z_.]*}', self._sessions.simulator_page)
        application.router.add_get('/{name:[a-z_.]*}', self._files.answer)
        return application

    async def _end(self, application: web.Application) -> None:
        await self._sessions.close()

    async def _module(self, request: web.Request) -> web.StreamResponse:
        module = self._modules.get(request.match_info['name'])
        if module is None:
            raise web.HTTPNotFound(text='there is no such module')
        return self._files.response(module.read_bytes(), request.host, 'text/javascript')

    async def _open(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(max_msg_size=MESSAGE_BYTES, heartbeat=PING_SECONDS)
        await socket.prepare(request)
        hello = await self._greetings.hello(socket, request)
        if hello is not None and hello['user'].role < Role.MAINTAINER:
            await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b'the studio needs the role maintainer')
        elif hello is not None:
            await self._sessions.serve(socket, lambda: self._access.admits(hello['user']))
        return socket


def application(folder: str, access: Access, robots: FleetLink) -> web.Application:
    """Return the studio as a part of the operator's page; the entry point of flexbt_console. Raises UsageError."""
    return StudioServer(workbench_for(folder), access, editor_folder(), robots).application()


def workbench_for(folder: str) -> Workbench:
    """Return the workbench of a folder. Print what could not be loaded. Raises UsageError."""
    if not Path(folder).is_dir():
        raise UsageError(f'{folder} is not a folder; name the folder of your mission')
    workbench = Workbench(folder)
    for note in workbench.notes:
        print(f'note: {note}', file=sys.stderr)
    return workbench


# CodeMirror's modules.


def editor_folder() -> Path | None:
    """Return the folder ``node_modules`` that has CodeMirror; None if it was not installed."""
    given = os.environ.get(EDITOR_FOLDER)
    home = home_directory()
    own = [] if home is None else [home.joinpath('.local', *_INSTALLED)]
    places = [Path(given)] if given else [Path(sys.prefix, *_INSTALLED), *own]
    return next((place for place in places if (place / '@codemirror' / 'view' / 'package.json').is_file()), None)


_INSTALLED: Final = ('share', 'flexbt_studio', 'node_modules')


def editor_modules(folder: Path) -> dict[str, Path]:
    """Return the file of each module in a folder ``node_modules``, by its name in imports."""
    found: dict[str, Path] = {}
    for description in sorted([*folder.glob('*/package.json'), *folder.glob('@*/*/package.json')]):
        package: dict[str, Any] = json.loads(description.read_text(encoding='utf-8'))
        exports = package.get('exports')
        entry = package.get('module') or (exports.get('import') if isinstance(exports, dict) else None)
        if isinstance(entry, str):
            found[description.parent.relative_to(folder).as_posix()] = description.parent / entry
    return found
