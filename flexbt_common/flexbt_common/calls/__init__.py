# SPDX-License-Identifier: BSD-3-Clause
"""Actions and services with deadlines and exactly one outcome, for clients and servers."""
