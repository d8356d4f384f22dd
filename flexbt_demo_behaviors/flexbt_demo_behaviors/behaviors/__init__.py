# SPDX-License-Identifier: BSD-3-Clause
"""The behaviors of the demonstrations, and their own state."""

from .inspection import Inspection, InspectSite
from .navigate import Navigate
from .navigate_split import NavigateSplit
from .show_path_state import ShowPathState

__all__ = ['InspectSite', 'Inspection', 'Navigate', 'NavigateSplit', 'ShowPathState']
