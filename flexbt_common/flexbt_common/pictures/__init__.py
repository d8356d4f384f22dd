# SPDX-License-Identifier: BSD-3-Clause
"""State machines and trees as pictures in Graphviz's language, Mermaid's, and SVG. Needs no ROS."""
