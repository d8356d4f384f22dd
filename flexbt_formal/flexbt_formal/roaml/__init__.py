# SPDX-License-Identifier: BSD-3-Clause
"""Models in the format of AS2FM (RoAML), and the probabilities of their properties."""
