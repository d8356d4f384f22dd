# SPDX-License-Identifier: BSD-3-Clause
"""What is asked for: capabilities, specifications and requests as files, and their translation to formulas."""

from .capability_file import Capability, CapabilityFile, Mappings, read_capabilities, read_mappings
from .hand_written import hand_written, is_whole
from .interface import Interface, Interfaces, UnknownParameterError, read_interfaces
from .request import FAILURE_OUTCOMES, Request, read_request
from .specification_file import SpecificationFile, as_structured_slugs, read_specification
from .translation import OBJECTIVE, ONE_ACTIVE, Liveness, Options, Problem, translated
from .vocabulary import Vocabulary
from .yaml_nodes import YamlFile

__all__ = [
    'FAILURE_OUTCOMES',
    'OBJECTIVE',
    'ONE_ACTIVE',
    'Capability',
    'CapabilityFile',
    'Interface',
    'Interfaces',
    'Liveness',
    'Mappings',
    'Options',
    'Problem',
    'Request',
    'SpecificationFile',
    'UnknownParameterError',
    'Vocabulary',
    'YamlFile',
    'as_structured_slugs',
    'hand_written',
    'is_whole',
    'read_capabilities',
    'read_interfaces',
    'read_mappings',
    'read_request',
    'read_specification',
    'translated',
]
