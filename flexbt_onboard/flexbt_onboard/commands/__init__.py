# SPDX-License-Identifier: BSD-3-Clause
"""Commands of operators: the authority to send them, their requirements, effects and results."""
