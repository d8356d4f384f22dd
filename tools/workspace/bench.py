# SPDX-License-Identifier: BSD-3-Clause
"""`make bench`: every benchmark of benchmarks/, one after the other; the figures together in out/bench/results.json."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from workspace.errors import WorkspaceError
from workspace.workspace import Workspace


def run(workspace: Workspace) -> int:
    """Run `python3 benchmarks NAME --output FILE.json` for each; gives the exit code, 1 when one of them fails."""
    layout = workspace.layout
    directory = layout.out / 'bench'
    directory.mkdir(parents=True, exist_ok=True)
    scripts = sorted(layout.benchmarks.glob('*/[!_]*.py'))
    if not scripts:
        raise WorkspaceError(f'there is no benchmark in {layout.benchmarks}')
    results: dict[str, Any] = {}
    failed = []
    for script in scripts:
        output = directory / f'{script.stem}.json'
        output.unlink(missing_ok=True)
        print(f'--- {script.stem}', flush=True)
        command = workspace.inside(['python3', layout.benchmarks, script.stem, '--output', output])
        ended = subprocess.run([str(word) for word in command], env=workspace.environment, cwd=layout.root)
        if ended.returncode == 0 and output.exists():
            results[script.stem] = json.loads(output.read_text(encoding='utf-8'))
        else:
            failed.append(f'{script.stem} (exit code {ended.returncode})')
    report = {'machine': _machine(layout.root), 'results': results, 'failed': failed}
    file = directory / 'results.json'
    file.write_text(json.dumps(report, indent=2) + '\n', encoding='utf-8')
    print(f'benchmarks: {len(results)} done{", failed: " + ", ".join(failed) if failed else ""}; figures in {file}')
    return 1 if failed else 0


def _machine(root: Path) -> dict[str, Any]:
    """Return what the figures depend on."""
    commit = subprocess.run(['git', 'rev-parse', '--short', 'HEAD'], cwd=root, capture_output=True, text=True)
    return {
        'time': datetime.now(UTC).isoformat(timespec='seconds'),
        'commit': commit.stdout.strip(),
        'system': platform.platform(),
        'processor': _processor(),
        'cores': os.cpu_count(),
        'load before': os.getloadavg()[0],
    }


def _processor() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(':')[2].strip() for line in lines if line.startswith('model name')), platform.machine())
