# SPDX-License-Identifier: BSD-3-Clause
"""The XML of BehaviorTree.CPP, formats 3 and 4: text, elements, definitions."""
