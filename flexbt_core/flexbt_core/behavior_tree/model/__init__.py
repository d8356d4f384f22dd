# SPDX-License-Identifier: BSD-3-Clause
"""What a tree is, apart from any run of it: status, ports, blackboard, definitions, errors."""
