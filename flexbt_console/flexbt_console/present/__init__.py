# SPDX-License-Identifier: BSD-3-Clause
"""What the console knows, as text for people and as JSON for programs, and what has changed in it."""

from . import json_form, rendering
from .events import Event, Follower

__all__ = ['Event', 'Follower', 'json_form', 'rendering']
