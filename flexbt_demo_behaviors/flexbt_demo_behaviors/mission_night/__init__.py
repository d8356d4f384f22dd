# SPDX-License-Identifier: BSD-3-Clause
"""A robot works through a queue of missions at night, and somebody is called if it needs one."""
