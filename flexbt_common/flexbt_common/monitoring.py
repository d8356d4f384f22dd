# SPDX-License-Identifier: BSD-3-Clause
"""The parameters that enable the monitors of a node."""

from __future__ import annotations

from typing import Final

from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.errors import FlexbtError
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.monitors.requirement_text import StatedRequirement, read_requirements
from flexbt_core.values.text_files import TextFileError, read_text

from .errors import UnfitParameterError
from .files import home_path

_MOST_BYTES: Final = 1_000_000


def declare_monitoring(declare: ParameterDeclarer) -> Monitoring:
    """Declare ``monitors``, ``monitor_action`` and ``requirements``.

    Raises:
        UnfitParameterError: a value cannot work, or the file is wrong; the text has parameter and value.
    """
    is_on = declare.flag(
        'monitors', False, 'whether monitors check each run, for example for two owners of an actuator'
    )
    about = 'what a violation causes: warn, or stop the run as well'
    action = declare.text('monitor_action', 'warn', about)
    if action not in ('warn', 'stop'):
        raise UnfitParameterError('monitor_action', f'{action!r} is neither warn nor stop; {about}')
    about = 'YAML file of further requirements, as for "behavior_tool prove"'
    written = declare.fixed.text('requirements', '', about)
    return Monitoring(is_on, action == 'stop', _requirements(written) if written and is_on else {})


def _requirements(written: str) -> dict[str, tuple[StatedRequirement, ...]]:
    try:
        return read_requirements(read_text(home_path(written), _MOST_BYTES), written)
    except TextFileError as error:
        raise UnfitParameterError('requirements', f'{written}: {error}') from None
    except FlexbtError as error:
        raise UnfitParameterError('requirements', str(error)) from None
