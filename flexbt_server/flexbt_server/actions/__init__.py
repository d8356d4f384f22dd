# SPDX-License-Identifier: BSD-3-Clause
"""The actions of the server, and the goals that become runs of trees."""
