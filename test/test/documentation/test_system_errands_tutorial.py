# SPDX-License-Identifier: BSD-3-Clause
"""The package of the tutorial, taken literally from its text: it builds, and its behavior runs an errand."""

import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix

ROOT = Path(__file__).parents[3]
PAGE = ROOT / 'docs' / 'tutorials' / 'errands.md'
FENCE = '```'
OUTCOME_TIMEOUT_S = 120


ALL_ARE_READY = """until console status --json --timeout 60 | python3 -c "
import json, sys
ready = {peer['name'] for peer in json.load(sys.stdin)['peers'] if peer['ready']}
sys.exit(not {'/simulator', '/navigation', '/bt_server'} <= ready)
"; do sleep 1; done"""
"""On a busy machine a robot begins more slowly than a person types."""


def files_of_package(text: str) -> dict[str, str]:
    """Return the files that the page shows: each fenced block after a paragraph that begins with a name in
    backquotes."""
    files: dict[str, str] = {}
    name = ''
    lines = iter(text.splitlines())
    for line in lines:
        begun = re.match(r'`([\w./]+\.\w+)`', line)
        if begun:
            name = begun.group(1)
        elif line.startswith(FENCE) and name:
            files[name] = '\n'.join(iter(lambda: next(lines), FENCE)) + '\n'
            name = ''
    return files


def commands(text: str) -> list[str]:
    """Return the shell commands of the page, in their order."""
    blocks = re.findall(rf'^{FENCE}sh\n(.*?)^{FENCE}$', text, re.MULTILINE | re.DOTALL)
    return [line for block in blocks for line in block.splitlines() if line.strip()]


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Return a user's workspace with the package, in what is the home directory of the test."""
    package = tmp_path / 'errands_ws' / 'src' / 'errands'
    files = files_of_package(PAGE.read_text(encoding='utf-8'))
    for name, content in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(content, encoding='utf-8')
    for name in ('resource/errands', 'errands/__init__.py'):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).touch()
    assert set(files) == {
        'package.xml',
        'setup.py',
        'setup.cfg',
        'errands/count_state.py',
        'errands/path_shorter_than.py',
        'errands/behavior.py',
        'trees/errand.xml',
    }
    return tmp_path


def test_the_package_of_the_tutorial_builds_and_runs_an_errand(workspace: Path) -> None:
    first, *rest = commands(PAGE.read_text(encoding='utf-8'))
    assert first.startswith('. tools/env.sh')  # the environment of this test is that one
    # On a busy machine the nodes take longer than a console waits for them by itself.
    rest = [re.sub(r'^(console (?:start|input) [^#]*)', rf'\1 --timeout {OUTCOME_TIMEOUT_S} ', line) for line in rest]
    # The last command watches until it is interrupted, here for a limited time; then the background processes end.
    script = ["trap 'kill $(jobs -p)' EXIT", *rest]
    script.insert(next(n for n, line in enumerate(script) if line.startswith('console start')), ALL_ARE_READY)
    assert script[-1].startswith('console watch')
    script[-1] = f'console watch --json --timeout {OUTCOME_TIMEOUT_S}'
    programs = ('flexbt_sim', 'flexbt_navigation', 'flexbt_server', 'flexbt_onboard', 'flexbt_console', 'flexbt_tools')
    path = [f'{get_package_prefix(name)}/lib/{name}' for name in programs]
    process = subprocess.Popen(
        ['bash', '-e', '-c', '\n'.join(script)],
        env=os.environ
        | {
            'HOME': str(workspace),
            'PATH': os.pathsep.join([*path, os.environ['PATH']]),
            'FLEXBT_ROOT': str(ROOT),
            'PYTHONFAULTHANDLER': '1',
        },
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    lines: list[str] = []
    assert process.stdout is not None
    try:
        for line in process.stdout:
            lines.append(line)
            if re.search(r'"event": *"status".*"outcome": *"\w+"', line):
                break
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        try:
            process.communicate(timeout=60)  # the pipe is open as long as any of the processes lives
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGABRT)  # the fault handler prints what each thread is doing
            pytest.fail(f'a process did not end in time\n{process.communicate()[0]}')
    assert lines, 'nothing was printed'
    assert re.search(r'"outcome": *"finished"', lines[-1]), ''.join(lines)
