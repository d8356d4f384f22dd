# SPDX-License-Identifier: BSD-3-Clause
"""Sphinx's configuration of the documentation; docs/tools/build.py runs it."""

import shlex
import sys

project = 'FlexBT'
author = 'The FlexBT developers'
copyright = author
release = '0.1.0'

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.viewcode', 'sphinx_copybutton', 'sphinxcontrib.mermaid']
exclude_patterns = ['tools']

# As in the documentation of Fast DDS and of Vulcanexus; sphinx_rtd_theme, which docs.ros.org has, knows no dark form.
html_theme = 'furo'
html_title = f'{project} {release}'
html_static_path = ['style']
html_css_files = ['tables.css']
html_copy_source = False
html_show_sphinx = False

# Anchors of headings as GitHub makes them, so that links hold in both.
myst_heading_anchors = 4
myst_fence_as_directive = ['mermaid']

# Diagrams are drawn at build time; a reader's browser needs neither a script nor a host.
mermaid_output_format = 'svg'
mermaid_cmd = shlex.join([sys.executable, '-m', 'mermaidx'])
mermaid_params = ['--theme', 'default', '--background', 'white', '--quiet']

# An annotation `type` is also the name of attributes; Sphinx takes the first and says so.
suppress_warnings = ['ref.python']

autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_typehints_format = 'short'
autodoc_class_signature = 'mixed'
autodoc_default_options = {'members': True, 'show-inheritance': True}
