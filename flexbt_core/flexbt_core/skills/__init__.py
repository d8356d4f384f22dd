# SPDX-License-Identifier: BSD-3-Clause
"""Skills: what a leaf or a state needs, what it brings about, and how it may fail. Said once, for all who ask.

A class declares its manifest as ``skill``, or a YAML file does for classes that are somebody else's::

    class OpenDoor(StatefulAction):
        skill = Skill.of(parameters={'door': 'door'}, outcomes={'SUCCESS': ['open(door)']}, resources=['arm'])

Planning, synthesis, proof, checks and the reference pages all read it. Nothing here knows the engines.
"""

from typing import TYPE_CHECKING, Any

from .errors import SkillError
from .grounding import GroundAction, GroundProblem, argument_texts, ground
from .library import ANYTHING, SkillLibrary, clashes
from .literals import (
    EQUAL,
    BlackboardSensor,
    ConditionSensor,
    Literal,
    Predicate,
    Sensor,
    TopicSensor,
    literals,
    parse_literal,
)
from .observation import SkillMonitor, claims
from .skill import LEVELS, Outcome, OutcomeClass, Skill, class_of

if TYPE_CHECKING:
    from .capabilities import capability_file
    from .yaml_reader import read_skills
    from .yaml_writer import skill_entry, write_skills

__all__ = [
    'ANYTHING',
    'EQUAL',
    'LEVELS',
    'BlackboardSensor',
    'ConditionSensor',
    'GroundAction',
    'GroundProblem',
    'Literal',
    'Outcome',
    'OutcomeClass',
    'Predicate',
    'Sensor',
    'Skill',
    'SkillError',
    'SkillLibrary',
    'SkillMonitor',
    'TopicSensor',
    'argument_texts',
    'capability_file',
    'claims',
    'clashes',
    'class_of',
    'ground',
    'literals',
    'parse_literal',
    'read_skills',
    'skill_entry',
    'write_skills',
]

if not TYPE_CHECKING:  # type checkers would take any name for one of this module

    def __getattr__(name: str) -> Any:
        """PyYAML takes a while to be imported, and classes that declare a skill need none of it."""
        if name not in __all__:
            raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
        from . import capabilities, yaml_reader, yaml_writer

        return next(found for one in (capabilities, yaml_reader, yaml_writer) if (found := getattr(one, name, None)))
