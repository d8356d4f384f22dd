# SPDX-License-Identifier: BSD-3-Clause
"""The interfaces to Groot2: its protocol for running trees, the XML that describes them, and log files (``.btlog``)."""
