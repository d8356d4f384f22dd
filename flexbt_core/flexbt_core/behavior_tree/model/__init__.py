# SPDX-License-Identifier: BSD-3-Clause
"""Trees apart from any run: status, ports, blackboard, definitions, errors."""
