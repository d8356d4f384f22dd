# SPDX-License-Identifier: BSD-3-Clause
"""The action ``get_userdata``: what the states of the run have handed to each other, for who looks for a fault."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flexbt_common import names
from flexbt_common.calls import GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import Encoding, to_entry
from flexbt_core.values import shown
from flexbt_msgs.action import GetUserdata
from flexbt_msgs.msg import BlackboardEntry, UserdataScope
from flexbt_onboard.runs import RunSupervisor

Result = GetUserdata.Result


class UserdataServer:
    """Serves GetUserdata. Used on the executor thread only; the values are written down on the thread of the run."""

    def __init__(self, runtime: NodeRuntime, runs: RunSupervisor) -> None:
        self._runtime = runtime
        self._runs = runs
        GoalServer(runtime, GetUserdata, names.GET_USERDATA, self._serve, _cancel, refused=_refused)

    def _serve(self, goal: ServedGoal) -> None:
        run = self._runs.run
        if run is None:
            goal.abort(_refused('no behavior is running'))
            return
        result = Result(code=Result.SUCCESS, run_id=run.run_id)

        def see(userdata: Mapping[str, Mapping[str, Any]]) -> None:
            _fill(result, goal.request, userdata)

        def answer(reason: str | None) -> None:
            if reason is not None:
                result.code, result.message = Result.FAILURE, reason
            self._runtime.post(end)

        def end() -> None:
            (goal.succeed if result.code == Result.SUCCESS else goal.abort)(result)

        run.command(lambda machine, once: machine.inspect(see, once), answer)


def _refused(why: str) -> Any:
    return Result(code=Result.FAILURE, message=why)


def _cancel(goal: ServedGoal) -> None:
    goal.canceled(Result(code=Result.CANCELED, message='canceled before the states of the run came to their next step'))


def _fill(result: Any, request: Any, userdata: Mapping[str, Mapping[str, Any]]) -> None:
    """Write what is asked for into the result."""
    encoding = Encoding.BINARY if request.encoding == GetUserdata.Goal.BINARY else Encoding.TEXT
    chosen = {path: values for path, values in userdata.items() if request.path in ('', path)}
    found = {key for values in chosen.values() for key in values}
    missing = [key for key in request.keys if key not in found]
    if not chosen:
        active = ', '.join(userdata)
        result.code, result.message = Result.FAILURE, f'{request.path!r} is no active machine; these are: {active}'
    elif missing:
        who = f'machine {request.path} has no' if request.path else 'no active machine has a'
        names_of_keys = ', '.join(sorted(found)) or 'none'
        result.code = Result.FAILURE
        result.message = f'{who} value for {", ".join(map(repr, missing))}; there are: {names_of_keys}'
    for path, values in chosen.items():
        keys = [key for key in sorted(values) if not request.keys or key in request.keys]
        if keys:
            entries = [_entry(key, values[key], encoding) for key in keys]
            result.scopes.append(UserdataScope(path=path, entries=entries))


def _entry(key: str, value: Any, encoding: Encoding) -> BlackboardEntry:
    try:
        return to_entry(key, value, None, encoding)
    except Exception:  # it has no type of ROS, or its own code raises
        return BlackboardEntry(key=key, text=shown(value))
