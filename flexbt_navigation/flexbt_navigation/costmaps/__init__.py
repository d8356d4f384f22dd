# SPDX-License-Identifier: BSD-3-Clause
"""The costmap server, its costmaps and their layers."""
