# SPDX-License-Identifier: BSD-3-Clause
"""Installing pinned packages into a virtual environment: by uv, and by pip where uv is not to be had or fails.

uv takes a fifth of the time: it downloads many packages at once, keeps them unpacked for the next clone, and leaves it
to Python to compile what is imported. It comes by way of pip, and pip comes with Python: as the wheel which ensurepip
would install, and which runs as it is. What configures pip (pip.conf, PIP_INDEX_URL and the like) holds for uv as well.
"""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import subprocess
import sysconfig
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from workspace.errors import CommandError, WorkspaceError
from workspace.terminal import Step, step

_REMEDY = (
    'mend what the log names: most often the network, or the proxy (HTTPS_PROXY, PIP_INDEX_URL); '
    'then run the same command again'
)

# A setting of pip -> the variable that says the same to uv.
_VARIABLES = {
    'cert': 'SSL_CERT_FILE',
    'client-cert': 'SSL_CLIENT_CERT',
    'default-timeout': 'UV_HTTP_TIMEOUT',
    'extra-index-url': 'UV_INDEX',
    'find-links': 'UV_FIND_LINKS',
    'index-url': 'UV_DEFAULT_INDEX',
    'keyring-provider': 'UV_KEYRING_PROVIDER',
    'no-cache-dir': 'UV_NO_CACHE',
    'proxy': 'ALL_PROXY',
    'retries': 'UV_HTTP_RETRIES',
    'timeout': 'UV_HTTP_TIMEOUT',
    'trusted-host': 'UV_INSECURE_HOST',
}
# Settings of pip that change nothing of what is installed, or from where.
_WITHOUT_EFFECT = {
    'break-system-packages',
    'cache-dir',
    'compile',
    'config-file',
    'constraint',  # the locks decide, and uv takes no constraint without a hash beside one
    'debug',
    'disable-pip-version-check',
    'exists-action',
    'log',
    'no-color',
    'no-compile',
    'no-input',
    'no-python-version-warning',
    'no-warn-conflicts',
    'no-warn-script-location',
    'prefer-binary',
    'progress-bar',
    'quiet',
    'require-virtualenv',
    'root-user-action',
    'upgrade-strategy',
    'use-deprecated',
    'use-feature',
    'user',
    'verbose',
}
_SECTIONS = ('global', 'install', ':env:')  # of pip's configuration; what comes later holds


class Run(Protocol):
    """Runs a command with its output in the log file of that name. Raises CommandError."""

    def __call__(
        self,
        command: Sequence[str | Path],
        log: str,
        what: str,
        shown: Step,
        *,
        remedy: str = '',
        progress: Callable[[Path], str] = ...,
        variables: Mapping[str, str] = ...,
    ) -> None: ...


def bundled_pip() -> Path | None:
    """Return the wheel of pip that came with this Python; distributions of Linux keep it in a place of their own."""
    places = [Path(place) for place in (sysconfig.get_config_var('WHEEL_PKG_DIR'),) if place]
    ensurepip = importlib.util.find_spec('ensurepip')
    if ensurepip is not None and ensurepip.origin:
        places.append(Path(ensurepip.origin).parent / '_bundled')
    return next((wheel for place in places for wheel in sorted(place.glob('pip-*.whl'))), None)


class Installer:
    """Installs into the virtual environment of the interpreter `python`, which needs to have nothing, not even pip."""

    def __init__(self, python: Path, environment: Mapping[str, str], run: Run) -> None:
        self._python = python
        self._environment = environment
        self._run = run
        self._uv = python.parent / 'uv'
        self._cache = cache_variables(environment, python.parents[1] / 'cache')

    def install(self, locks: Sequence[Path], uv: Path) -> None:
        """Install what the files `locks` name, and only files whose hashes they have; the file `uv` names uv.

        Raises CommandError.
        """
        expected = sum(len(re.findall(r'^[\w.-]+==', file.read_text('utf-8'), re.MULTILINE)) for file in locks)
        files = ['--require-hashes', *(word for file in locks for word in ('--requirement', file))]
        try:
            with step('installer (uv)') as shown:
                command = [*self._pip('install'), '--require-hashes', '--requirement', uv]
                self._run(command, 'setup-uv.log', 'pip', shown, variables=self._cache)
                variables = self._cache | uv_variables(self._configuration_of_pip(), self._environment)
                shown.outcome = 'installed'
            with step('ROS 2 and tools (uv)') as shown:
                command = [self._uv, 'pip', 'install', '--python', self._python, *files]
                self._run(
                    command,
                    'setup-install.log',
                    'uv',
                    shown,
                    progress=lambda log: progress_of_uv(log, expected, self._installed()),
                    variables=variables,
                )
                shown.outcome = 'installed'
        except WorkspaceError as error:
            if isinstance(error, CommandError) and (error.was_killed or error.disk_was_full):
                raise
            why = f'see {error.log}' if isinstance(error, CommandError) else error.message
            print(f'    continuing without uv, with pip alone, which takes longer ({why})', flush=True)
        else:
            if self._environment.get('PYTHONDONTWRITEBYTECODE'):  # or every start of a program compiles everything
                self._compile_modules()
            return
        with step('ROS 2 and tools (pip)') as shown:
            self._run(
                [*self._pip('install'), *files],
                'setup-install.log',
                'pip',
                shown,
                remedy=_REMEDY,
                progress=lambda log: progress_of_pip(log, expected, self._installed()),
                variables=self._cache,
            )
            shown.outcome = 'installed'

    def _compile_modules(self) -> None:
        """Let Python compile all modules. uv could, but it would report nothing for minutes."""
        modules = sum(1 for place in self._site_packages() for _ in place.rglob('*.py'))
        program = 'import compileall, sys; [compileall.compile_dir(place, workers=0) for place in sys.argv[1:]]'
        with step('compilation of modules') as shown:
            self._run(
                [self._python, '-u', '-c', program, *self._site_packages()],
                'setup-modules.log',
                'compiling the modules',
                shown,
                progress=lambda log: f'{log.read_bytes().count(b"Compiling ")} of {modules} modules compiled',
            )

    def _site_packages(self) -> list[Path]:
        return list(self._python.parents[1].glob('lib/python3.*/site-packages'))

    def _installed(self) -> int:
        """Return the number of packages that are in place."""
        return sum(1 for place in self._site_packages() for _ in place.glob('*.dist-info'))

    def _pip(self, command: str) -> list[str | Path]:
        wheel = bundled_pip()
        if wheel is None:
            raise WorkspaceError(f'{self._python} came without pip', 'install its venv and ensurepip modules')
        options = ['--no-input', '--disable-pip-version-check', '--progress-bar', 'off'] if command == 'install' else []
        return [self._python, wheel / 'pip', command, *options]

    def _configuration_of_pip(self) -> str:
        words = [str(word) for word in [*self._pip('config'), 'list']]
        return subprocess.run(words, env=dict(self._environment), capture_output=True, text=True).stdout


def cache_variables(environment: Mapping[str, str], spare: Path) -> dict[str, str]:
    """Return the variable by which uv and pip keep what they download in `spare`, where they could not write to their
    cache.

    The home of a user of a container may be no directory, or one of somebody else. Without a cache uv does nothing, and
    pip builds no wheels.
    """
    try:
        cache = Path(environment.get('XDG_CACHE_HOME') or Path(environment.get('HOME') or Path.home()) / '.cache')
        cache.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # that of a user without an account, who has no home
        return {'XDG_CACHE_HOME': str(spare)}
    return {} if os.access(cache, os.W_OK | os.X_OK) else {'XDG_CACHE_HOME': str(spare)}


def uv_variables(configuration: str, environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables by which uv looks where pip would look, from what `pip config list` prints.

    What `environment` says to uv itself holds before that. Raises WorkspaceError for a setting that uv may not know.
    """
    values: dict[str, str] = {}
    for section in _SECTIONS:
        for line in configuration.splitlines():
            key, _, text = line.partition('=')
            if key.startswith(f'{section}.'):
                values[key.removeprefix(f'{section}.')] = str(ast.literal_eval(text))
    # As pip takes them: the best version on any of the indexes, and certificates as the library `requests` finds them.
    result = {'UV_INDEX_STRATEGY': 'unsafe-best-match'}
    for name in ('CURL_CA_BUNDLE', 'REQUESTS_CA_BUNDLE'):
        if environment.get(name):
            result['SSL_CERT_FILE'] = environment[name]
    for name, value in values.items():
        if name in _VARIABLES:
            result[_VARIABLES[name]] = (',' if name == 'find-links' else ' ').join(value.split())
        elif name not in _WITHOUT_EFFECT:
            raise WorkspaceError(f'pip is configured with {name}, which only pip knows')
    return {name: value for name, value in result.items() if name not in environment}


def progress_of_uv(log: Path, expected: int, installed: int) -> str:
    """Return what uv is doing to about `expected` packages, and how much of it is done, from its output.

    It names the size of large files only. `installed`: packages that are in place.
    """
    text = log.read_text(encoding='utf-8', errors='replace')
    packages = re.search(r'Resolved (\d+) packages', text)
    if packages is None:
        return f'step 1 of 3: looking up about {expected} packages'
    if 'Prepared ' in text:
        return f'step 3 of 3: {min(installed, int(packages[1]))} of {packages[1]} packages installed'
    sizes = {
        name: float(size) * {'K': 0.001, 'M': 1, 'G': 1000}[unit]
        for name, size, unit in re.findall(r'Downloading (\S+) \(([\d.]+)([KMG])iB\)', text)
    }
    here = sum(sizes.get(name, 0) for name in re.findall(r'Downloaded (\S+)', text))
    return f'step 2 of 3: {here:.0f} of {sum(sizes.values()):.0f} MB downloaded'


def progress_of_pip(log: Path, expected: int, installed: int) -> str:
    """Return how many of about `expected` packages pip has looked up, from its output, or `installed`."""
    text = log.read_text(encoding='utf-8', errors='replace')
    if 'Installing collected packages' in text:
        return f'{min(installed, expected)} of about {expected} packages installed'
    collected = _names(re.findall(r'Collecting ([\w.-]+)', text))
    return f'{len(collected)} of about {expected} packages looked up and downloaded'


def _names(names: Iterable[str]) -> set[str]:
    return {re.sub(r'[-_.]+', '-', name).lower() for name in names}
