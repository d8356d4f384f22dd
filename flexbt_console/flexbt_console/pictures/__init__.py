# SPDX-License-Identifier: BSD-3-Clause
"""Trees and maps as pictures: in the cells of a terminal, and the map as an image."""

from .cells import cut, cut_middle, fold, width
from .glyphs import ASCII, UNICODE, Glyphs, glyphs
from .map_canvas import Cell, Frame, Layer, MapCanvas, map_lines, where_text
from .map_image import map_image, save_map
from .tree_lines import acting_lines, chains_of_failures, tree_lines, whole_tree_lines, window

__all__ = [
    'ASCII',
    'UNICODE',
    'Cell',
    'Frame',
    'Glyphs',
    'Layer',
    'MapCanvas',
    'acting_lines',
    'chains_of_failures',
    'cut',
    'cut_middle',
    'fold',
    'glyphs',
    'map_image',
    'map_lines',
    'save_map',
    'tree_lines',
    'where_text',
    'whole_tree_lines',
    'width',
    'window',
]
