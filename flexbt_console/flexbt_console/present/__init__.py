# SPDX-License-Identifier: BSD-3-Clause
"""What the console knows, as text for people and as JSON for programs, and what has changed in it."""

from .events import Event, Follower
from .json_form import encode_json, failure_json, result_json, status_json, structure_json
from .rendering import (
    age_text,
    authority_text,
    autonomy_text,
    behavior_line,
    behaviors_lines,
    choice_line,
    command_result_lines,
    decision_line,
    link_line,
    link_word,
    log_lines,
    peers_text,
    places_lines,
    pose_text,
    status_lines,
    structure_lines,
    userdata_lines,
)

__all__ = [
    'Event',
    'Follower',
    'age_text',
    'authority_text',
    'autonomy_text',
    'behavior_line',
    'behaviors_lines',
    'choice_line',
    'command_result_lines',
    'decision_line',
    'encode_json',
    'failure_json',
    'link_line',
    'link_word',
    'log_lines',
    'peers_text',
    'places_lines',
    'pose_text',
    'result_json',
    'status_json',
    'status_lines',
    'structure_json',
    'structure_lines',
    'userdata_lines',
]
