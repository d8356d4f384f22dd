# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's installed behaviors: found, described by their manifests, and run by the executive."""

from .discovery import entries
from .harmless_faults import without_harmless_faults

__all__ = ['entries', 'without_harmless_faults']
