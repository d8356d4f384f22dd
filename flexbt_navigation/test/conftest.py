# SPDX-License-Identifier: BSD-3-Clause
"""Lets the tests of all rooms import what they share: the modules beside this file."""
