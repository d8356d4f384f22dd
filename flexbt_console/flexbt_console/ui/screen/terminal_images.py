# SPDX-License-Identifier: BSD-3-Clause
"""Images in terminals that have a protocol for them: Sixel, or kitty's graphics protocol."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from textual_image.widget import AutoImage, SixelImage

    ImageWidget = type[AutoImage | SixelImage]

IMAGES: Final = 'FLEXBT_IMAGES'
"""1: the terminal is asked whether it has a protocol, whatever it is; 0: it is not asked."""

_TERMS: Final = ('xterm-kitty', 'xterm-ghostty', 'foot', 'wezterm', 'mlterm', 'contour')
_VARIABLES: Final = ('KITTY_WINDOW_ID', 'WEZTERM_PANE', 'KONSOLE_VERSION', 'ITERM_SESSION_ID', 'WT_SESSION')


def image_widget() -> ImageWidget | None:
    """The widget that shows an image in this terminal; None where it has no protocol for that.

    Only a terminal that is known to have one is asked for it: one that does not answer holds up the start. To be called
    before Textual has the terminal.
    """
    wanted = os.environ.get(IMAGES, '')
    known = os.environ.get('TERM', '').startswith(_TERMS) or any(map(os.environ.get, _VARIABLES))
    if wanted == '0' or not (wanted == '1' or known):
        return None
    try:
        from textual_image.renderable import HalfcellImage, Image, UnicodeImage

        if Image in (HalfcellImage, UnicodeImage):
            return None
        from textual_image.widget import Image as Widget
    except (ModuleNotFoundError, ZeroDivisionError):  # rosdep has no key for it; a terminal may have no columns yet
        return None
    return Widget
