# SPDX-License-Identifier: BSD-3-Clause
"""Trees and behaviors without a robot: check, show, draw, run with mocks."""
