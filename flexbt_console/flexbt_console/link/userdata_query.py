# SPDX-License-Identifier: BSD-3-Clause
"""Asking for the userdata of the run: a goal of the action ``get_userdata``."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future

from flexbt_common import names
from flexbt_common.calls import ActionCall, ActionLinks, GoalOutcome
from flexbt_common.runtime import NodeRuntime
from flexbt_console.errors import NoAnswerError, RefusedError
from flexbt_console.mirror import InputValue, UserdataScope
from flexbt_msgs.action import GetUserdata


def userdata(
    runtime: NodeRuntime, namespace: str, path: str, keys: Sequence[str], timeout: float
) -> tuple[UserdataScope, ...]:
    """Ask the executive of the robot in a namespace, '' for the node's own. Not on the executor thread.

    As a path, '' is that of every active machine; no keys are all.

    Raises:
        RefusedError: nothing runs, the machine is not active, or there is no such key.
        NoAnswerError: it is not told within ``timeout`` seconds, since a state keeps the run busy, or the link is bad.
    """
    done: Future[GoalOutcome] = Future()
    goal = GetUserdata.Goal(path=path, keys=list(keys), encoding=GetUserdata.Goal.TEXT)
    link = ActionLinks(runtime).link(GetUserdata, names.of_robot(namespace, names.GET_USERDATA))
    call = ActionCall(link, goal, on_done=done.set_result, server_timeout=timeout, accept_timeout=timeout)
    try:
        outcome = done.result(timeout)
    except TimeoutError:
        call.cancel()
        raise NoAnswerError(f'the userdata was not told within {timeout:g} s; a state may keep the run busy') from None
    result = outcome.result
    if result is None:
        raise NoAnswerError(outcome.reason)
    if result.code != GetUserdata.Result.SUCCESS:
        raise RefusedError(result.message)
    return tuple(
        UserdataScope(scope.path, tuple(InputValue(entry.key, entry.type, entry.text) for entry in scope.entries))
        for scope in result.scopes
    )
