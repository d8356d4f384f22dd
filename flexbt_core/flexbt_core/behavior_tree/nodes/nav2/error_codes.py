# SPDX-License-Identifier: BSD-3-Clause
"""Conditions of Nav2 on the error code that an action has left."""

from __future__ import annotations

from typing import ClassVar, Final

from flexbt_core.behavior_tree.engine import Condition
from flexbt_core.behavior_tree.model import INT, SUCCESS, UINT16, Example, NodeStatus, input_port, list_of


class AreErrorCodesPresent(Condition):
    """SUCCESS when ``error_code`` is one of ``error_codes_to_check``. A code that was never written counts as 0."""

    __slots__ = ()

    ports = {
        'error_code': input_port(UINT16, optional=True, description='code that an action has left'),
        'error_codes_to_check': input_port(list_of(INT), optional=True, description='codes, separated by ;'),
    }
    default_codes: ClassVar[tuple[int, ...]] = ()
    example = Example('<AreErrorCodesPresent error_code="106" error_codes_to_check="103;106"/>', ticks=(SUCCESS,))

    def tick(self) -> NodeStatus:
        code: int = self.get_input_or('error_code', 0)
        codes = self.get_input_or('error_codes_to_check', self.default_codes)
        return SUCCESS if code in codes else self.fail(f'error code {code} is none of {sorted(codes)}')


class WouldAControllerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when FollowPath failed for a reason that a recovery may remove.

    UNKNOWN, PATIENCE_EXCEEDED, FAILED_TO_MAKE_PROGRESS, NO_VALID_CONTROL.
    """

    __slots__ = ()

    default_codes = (100, 104, 105, 106)
    example = Example('<WouldAControllerRecoveryHelp error_code="{follow_path_error_code}"/>')


class WouldAPlannerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when a path planner failed for a reason that a recovery may remove: UNKNOWN, TIMEOUT, NO_VALID_PATH."""

    __slots__ = ()

    default_codes = (200, 207, 208, 300, 307, 308)
    example = Example('<WouldAPlannerRecoveryHelp error_code="{compute_path_error_code}"/>')


class WouldASmootherRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when SmoothPath failed for a reason that a recovery may remove.

    UNKNOWN, TIMEOUT, SMOOTHED_PATH_IN_COLLISION, FAILED_TO_SMOOTH_PATH.
    """

    __slots__ = ()

    default_codes = (500, 502, 503, 504)
    example = Example('<WouldASmootherRecoveryHelp error_code="{smoother_error_code}"/>')


class WouldARouteRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when no route was found for a reason that a recovery may remove: UNKNOWN, TIMEOUT, NO_VALID_ROUTE."""

    __slots__ = ()

    nav2_branch = 'main'
    default_codes = (400, 404, 405)
    example = Example('<WouldARouteRecoveryHelp error_code="{route_error_code}"/>')


NODES: Final = (
    AreErrorCodesPresent,
    WouldAControllerRecoveryHelp,
    WouldAPlannerRecoveryHelp,
    WouldASmootherRecoveryHelp,
    WouldARouteRecoveryHelp,
)
