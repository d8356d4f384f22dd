# SPDX-License-Identifier: BSD-3-Clause
"""The program ``python3 -m flexbt_formal.requests.search``, which the executive runs to synthesize for its operators.

The request is a line of JSON on the standard input: ``system`` or ``capabilities``, and the other fields of
SynthesizeBehavior; ``directories`` of capability files, ``memory`` (bytes) and ``seconds`` are limits. The standard
output has lines of JSON: ``doing``, and at the end ``code`` with the machine, its notes, or the reason
for its absence. Closing the standard input cancels the request and ends the program.
"""

from __future__ import annotations

import json
import os
import re
import resource
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from flexbt_common.errors import ResourceError
from flexbt_common.files import home_path, resolve_file
from flexbt_core.state_machine.authoring.yaml_form import read_machine
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_core.values.text import did_you_mean, one_line, truncate_middle
from flexbt_formal.synthesis.errors import SynthesisError, SynthesisTimeout
from flexbt_formal.synthesis.from_strategy import SynthesizedMachine
from flexbt_formal.synthesis.machine_text import machine_as_yaml, state_instantiations
from flexbt_formal.synthesis.request_files import MachineRequest
from flexbt_formal.synthesis.synthesis import synthesize, time_limited
from flexbt_formal.synthesis.translation import Liveness, Options
from flexbt_onboard.behaviors.machine_behavior import state_modules, states_of
from flexbt_onboard.errors import BrokenBehaviorError
from flexbt_tools.errors import UsageError
from flexbt_tools.files import read_text_file

from .synthesis import MAX_BYTES, StateInterfaces, SynthesisFiles, explanation_lines, read_problem

_NICENESS: Final = 10
_SYSTEM: Final = re.compile(r'[\w-][\w.-]{0,254}')

Tell = Callable[[Mapping[str, Any]], None]


def main() -> int:
    """Answer one request from the standard input, and return the exit code."""
    asked = json.loads(sys.stdin.readline())
    os.nice(_NICENESS)
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    limit = asked['memory'] if hard == resource.RLIM_INFINITY else min(asked['memory'], hard)
    resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
    with os.fdopen(os.dup(1), 'w', encoding='utf-8') as out:
        os.dup2(2, 1)  # redirect the prints of state constructors to the standard error

        def tell(told: Mapping[str, Any]) -> None:
            out.write(json.dumps(told) + '\n')
            out.flush()

        threading.Thread(target=_end_with_input, daemon=True).start()
        tell(searched(asked, tell))
    return 0


def _end_with_input() -> None:
    sys.stdin.read()
    os._exit(1)


def searched(asked: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Return the answer to a request, in the printed form; ``tell`` is called with the current activity."""
    try:
        return _answered(asked, tell)
    except (SynthesisError, SynthesisTimeout, UsageError, ResourceError, BrokenBehaviorError) as error:
        return {'code': 'wrong', 'message': str(error)}


def _answered(asked: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    directories = [home_path(one) for one in asked['directories']]
    files = SynthesisFiles(
        _capabilities(asked, directories),
        specification=str(_file(asked['specification'], directories)) if asked['specification'] else None,
    )
    request = MachineRequest(
        initial_conditions=tuple(asked['initial_conditions']),
        goals=tuple(asked['goals']),
        outcomes=tuple(asked['outcomes']),
        name=asked['name'],
    )
    how = Options(Liveness(asked['liveness']), asked['retries'])
    modules = state_modules()
    tell({'doing': 'the files are read'})
    problem = read_problem(files, request, StateInterfaces(modules), how)
    answer = synthesize(
        problem,
        time_limited(asked['seconds'], 'give it more time, or ask for less', lambda doing, _: tell({'doing': doing})),
    )
    if answer.machine is None:
        assert answer.explanation is not None
        return {
            'code': 'unrealizable',
            'message': f'no machine can do that: {answer.explanation.kind.value}',
            'explanation': list(explanation_lines(answer.explanation)),
        }
    if asked['with_states']:
        return {'code': 'made', 'states': state_instantiations(answer.machine)}
    inputs = (
        f"the machine reads '{key}', which no state writes: start it with --input {key}=TYPE:VALUE"
        for key in answer.machine.keys
    )
    text = _text(answer.machine, asked, modules)
    return {'code': 'made', 'machine': text, 'notes': [*answer.machine.notes, *inputs]}


def _text(machine: SynthesizedMachine, asked: Mapping[str, Any], modules: Sequence[str]) -> str:
    """Return the text of the machine. It is built once as a test, as the executive will build it."""
    goals, system = ', '.join(asked['goals']), asked['system'] or 'capabilities that were sent'
    text = f'# {one_line(goals or "its specification", 200)}, from {system}\n{machine_as_yaml(machine)}'
    try:
        read_machine(text, states_of(modules), asked['name'])
    except MachineError as error:
        raise SynthesisError(['there is a strategy, but the machine is not fit to run:', *error.problems]) from error
    return text


def _capabilities(asked: Mapping[str, Any], directories: Sequence[Path]) -> tuple[str, str]:
    """Return the text of the capabilities and its name: messages show only the file name, without directories."""
    if not asked['system']:
        return asked['capabilities'], 'capabilities'
    file = _file(asked['system'], directories)
    return read_text_file(str(file), MAX_BYTES), file.name


def _file(name: str, directories: Sequence[Path]) -> Path:
    """Return a file by the name of a system, or as ``package/path.yaml``. Raises ResourceError."""
    if '/' in name:
        return resolve_file(name, directories, 'capability_directories')
    known = {file.stem: file for one in directories for file in sorted(one.glob('*.yaml'))}
    if not _SYSTEM.fullmatch(name) or name not in known:
        among = f'{did_you_mean(name, known)}; there are {", ".join(known)}' if known else ''
        raise ResourceError(
            truncate_middle(name),
            f'no system in the capability_directories of the executive{among}; or name a file as package/path.yaml',
        )
    return known[name]


if __name__ == '__main__':
    sys.exit(main())
