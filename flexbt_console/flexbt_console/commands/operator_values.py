# SPDX-License-Identifier: BSD-3-Clause
"""Readers of the values that an operator types: levels, namespaces, places, ``x y yaw``, and values of any type."""

from __future__ import annotations

import functools
import json
import math
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.mirror.records import (
    AutonomyLevel,
    BehaviorParameter,
    Decision,
    FramedPose,
    InputValue,
    plain_type,
)
from flexbt_console.present.rendering import limits_text
from flexbt_core.values import places
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.text_files import TextFileError, read_text

MOST_COLUMNS: Final = 1000
"""Maximum columns, and maximum rows, of a drawing in cells."""
_FRAME: Final = 6
"""Columns, and rows, of the terminal that the frame of a dialog, or the prompt, occupies."""

SHELLS: Final = ('bash', 'zsh')
"""Shells with completion by Tab."""

_NAMESPACE: Final = re.compile(r'/|(/(?!\d)\w+)+', re.ASCII)


def autonomy_level(text: str) -> AutonomyLevel:
    """Read a level of autonomy, by name or number.

    Raises:
        UsageError: the text is neither.
    """
    names = {level.name.lower(): level for level in AutonomyLevel}
    numbers = {str(level.value): level for level in AutonomyLevel}
    level = names.get(text.lower(), numbers.get(text))
    if level is None:
        raise UsageError(f'{short_repr(text)} is not a level of autonomy; expected off, low, high, full or 0 to 3')
    return level


def assignment(text: str) -> tuple[str, str]:
    """Read ``PARAMETER=VALUE``.

    Raises:
        UsageError: the text has another form.
    """
    key, equals, value = text.partition('=')
    if not equals or not key:
        raise UsageError(f'{short_repr(text)}: expected PARAMETER=VALUE')
    return key, value


_STRUCTURES: Final[Mapping[str, tuple[type[Any], str]]] = {'list': (list, '[1, 2]'), 'dict': (dict, '{name: 1}')}
_BOOLEANS: Final = frozenset({'true', 'yes', 'on', '1', 'false', 'no', 'off', '0'})


def parameter_value(parameter: BehaviorParameter, text: str) -> str:
    """Check the value of a parameter of a behavior, and return its text. The executive checks values of other types.

    Raises:
        RefusedError: the value does not have the parameter's type, is none of its choices, or is beyond its limits.
    """
    where = f'parameter {short_repr(parameter.name)}: {short_repr(text)}'
    if parameter.choices:
        if text not in parameter.choices:
            raise RefusedError(f'{where} is none of its choices ({", ".join(parameter.choices)})')
        return text
    if parameter.type == 'bool' and text.strip().lower() not in _BOOLEANS:
        raise RefusedError(f'{where} is not a valid bool; expected true or false')
    if parameter.type in _STRUCTURES:
        from flexbt_core.values.yaml_data import YamlError, load_yaml  # help and completion need no YAML

        kind, example = _STRUCTURES[parameter.type]
        try:
            if not isinstance(load_yaml(text), kind):
                raise RefusedError(f'{where} is not a valid {parameter.type}; expected YAML such as {example}')
        except YamlError as error:
            problem = f'{where} is not a valid {parameter.type}: {error}; expected YAML such as {example}'
            raise RefusedError(problem) from None
    if parameter.type in ('int', 'float'):
        number = _number(text, int if parameter.type == 'int' else float)
        if isinstance(number, float) and math.isnan(number):  # which takes no int that is larger than any float
            expected = 'a whole number' if parameter.type == 'int' else 'a number'
            raise RefusedError(f'{where} is not a valid {parameter.type}; expected {expected}')
        if number < _number(parameter.minimum, float) or number > _number(parameter.maximum, float):  # NaN: no limit
            raise RefusedError(f'{where} is beyond its limits ({limits_text(parameter)})')
    return text


def _number(text: str, kind: type[int] | type[float]) -> float:
    try:
        return kind(text)
    except ValueError:
        return math.nan


def whole_number(text: str, *, least: int, most: float = math.inf) -> int:
    """Read an integer within these limits. Raises UsageError if the text is not one."""
    if not text.isascii() or not text.isdigit() or len(text) > 9 or not least <= int(text) <= most:
        limits = f'from {least} to {most}' if most < math.inf else f'of at least {least}'
        raise UsageError(f'{short_repr(text)}: expected a whole number {limits}')
    return int(text)


line_count: Final = functools.partial(whole_number, least=1)
retry_count: Final = functools.partial(whole_number, least=0, most=1000)
port_number: Final = functools.partial(whole_number, least=0, most=65535)
item_number: Final = functools.partial(whole_number, least=1)
run_count: Final = functools.partial(whole_number, least=1, most=1_000_000)


def one_of(choices: Sequence[str]) -> Callable[[str], str]:
    """Return a reader that accepts one of these words and raises UsageError for any other."""

    def read(text: str) -> str:
        if text not in choices:
            raise UsageError(f'{short_repr(text)}: expected {" or ".join(choices)}')
        return text

    return read


def node_result(text: str) -> str:
    """Return the result of a node. Raises UsageError if it is neither SUCCESS nor FAILURE."""
    return one_of(('SUCCESS', 'FAILURE'))(text.upper())


_CAPABILITIES: Final = 1_000_000


def capability_text(file: str) -> str:
    """Return the text of a capability file on this computer. Raises UsageError if it is empty or cannot be read."""
    try:
        text = read_text(file, _CAPABILITIES)
    except TextFileError as error:
        raise UsageError(f'{file}: cannot be read: {error}') from error
    if not text.strip():
        raise UsageError(f'{file}: empty; this is not a capability file')
    return text


def full_namespace(text: str) -> str:
    """Return the absolute namespace for the name of a robot, with or without its leading slash.

    Raises:
        UsageError: ROS does not allow the name.
    """
    full = '/' + text.strip('/')
    if _NAMESPACE.fullmatch(full) is None:
        raise UsageError(
            f'{short_repr(text)} is not a namespace of ROS: '
            'letters, digits and _ between slashes, no part begins with a digit'
        )
    return full


def load_places(file: Path) -> dict[str, FramedPose]:
    """Read a YAML file of named places; see :func:`flexbt_core.values.places.load_places`.

    Raises:
        UsageError: the file cannot be read, or an entry is not a place. The message contains the file and the entry.
    """
    try:
        known = places.load_places(file)
    except ValueError as error:
        raise UsageError(str(error)) from error
    return {name: FramedPose(place.x, place.y, place.yaw, place.frame) for name, place in known.items()}


def value_text(text: str, type: str, places: Mapping[str, FramedPose]) -> str:
    """Return the checked text of a value of ``type`` (as in BlackboardEntry), from the text that the operator typed.

    If a message type is not installed here, only the executive checks the value.

    Raises:
        RefusedError: the text is no value of the type.
    """
    short = plain_type(type)
    if short in ('string', 'str'):
        return json.dumps(text)
    is_array = short.endswith('[]')
    pose_form = _POSE_FORMS.get(short.removesuffix('[]'))
    if pose_form is not None and not text.lstrip().startswith(('{', '[')):
        poses = [pose_form(_pose(part, places)) for part in text.split(';')] if text.strip() else []
        if not is_array and len(poses) != 1:
            raise RefusedError(f'{short_repr(text)}: expected one pose: a place, or "x y yaw"')
        return json.dumps(poses if is_array else poses[0])
    return _checked_text(text, type)


def answer(decision: Decision, text: str, places: Mapping[str, FramedPose]) -> InputValue:
    """Return the value that answers an input request.

    Raises:
        RefusedError: the text is no value of the requested type, or none of the allowed choices.
    """
    allowed = decision.input_choices
    if allowed and text not in allowed:
        raise RefusedError(f'{short_repr(text)} is not allowed here; choose one of {", ".join(allowed)}')
    if allowed and decision.input_type.removesuffix('[]') not in ('string', 'str'):
        places = {}
    return InputValue('', decision.input_type, value_text(text, decision.input_type, places))


def start_input(text: str, places: Mapping[str, FramedPose]) -> InputValue:
    """Read ``key=type:value``, an input of a behavior to start.

    Raises:
        UsageError: the text has another form.
        RefusedError: the value does not have this type.
    """
    key, equals, rest = text.partition('=')
    type, colon, value = rest.partition(':')
    if not (key and equals and type and colon):
        raise UsageError(
            f'--input {short_repr(text)}: expected key=type:value, e.g. goal=geometry_msgs/PoseStamped:1 2 0'
        )
    return InputValue(key, type, value_text(value, type, places))


def _pose(text: str, places: Mapping[str, FramedPose]) -> FramedPose:
    words = text.split()
    if len(words) == 1 and words[0] in places:
        return places[words[0]]
    try:
        x, y, *rest = (float(word) for word in words)
        (yaw,) = rest or (0.0,)
    except ValueError:
        known = f'; the places are {", ".join(sorted(places))}' if places else '; there are no named places'
        remedy = did_you_mean(text.strip(), places, known)
        raise RefusedError(
            f'{short_repr(text.strip())} is neither a place nor "x y yaw" (metres, radians){remedy}'
        ) from None
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(yaw)):
        raise RefusedError(f'{short_repr(text.strip())}: a pose has finite numbers')
    return FramedPose(x, y, yaw)


def _pose_plain(place: FramedPose) -> dict[str, Any]:
    return {
        'position': {'x': place.x, 'y': place.y},
        'orientation': {'z': math.sin(place.yaw / 2.0), 'w': math.cos(place.yaw / 2.0)},
    }


_POSE_FORMS: Final[Mapping[str, Callable[[FramedPose], dict[str, Any]]]] = {
    'geometry_msgs/PoseStamped': lambda place: {
        'header': {'frame_id': place.frame},
        'pose': _pose_plain(place),
    },
    'geometry_msgs/Pose': _pose_plain,
    'geometry_msgs/Pose2D': lambda place: {'x': place.x, 'y': place.y, 'theta': place.yaw},
}
"""Functions that convert a pose to the plain data of a message, for each of :data:`POSE_TYPES`."""


def _checked_text(text: str, type: str) -> str:
    # Imported late, because these import rclpy and the interface packages, which takes long.
    from flexbt_common.errors import UnknownTypeError, ValueConversionError
    from flexbt_common.values.entries import text_to_value, value_to_text
    from flexbt_common.values.value_types import resolve_type

    try:
        resolved = resolve_type(type)
    except UnknownTypeError:
        return text
    try:
        return value_to_text(text_to_value(text, resolved.name), resolved.name)
    except ValueConversionError as error:
        raise RefusedError(f'{short_repr(text)} is not a valid {type}: {error.reason}') from error


def map_size(text: str) -> tuple[int, int]:
    """Return columns and rows of a map, from a text such as 80x24; for an empty text, the size that fits the terminal.

    Raises:
        UsageError: the text has another form, or the size is too small or too large.
    """
    if not text:
        room = shutil.get_terminal_size()
        return min(MOST_COLUMNS, max(8, room.columns - _FRAME)), min(MOST_COLUMNS, max(4, room.lines - _FRAME))
    columns, x, rows = text.partition('x')
    if x and all(part.isascii() and part.isdigit() and len(part) < 5 for part in (columns, rows)):
        size = int(columns), int(rows)
        if 8 <= size[0] <= MOST_COLUMNS and 4 <= size[1] <= MOST_COLUMNS:
            return size
    raise UsageError(
        f'{short_repr(text)}: expected COLUMNSxROWS, as in 80x24, from 8x4 to {MOST_COLUMNS}x{MOST_COLUMNS}'
    )
