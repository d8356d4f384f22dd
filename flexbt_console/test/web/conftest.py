# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the tests of page and HTTP interface."""

from http_support import site as site
