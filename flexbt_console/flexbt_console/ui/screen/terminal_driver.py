# SPDX-License-Identifier: BSD-3-Clause
"""Textual's driver for a terminal, mended where the process goes on after it was stopped."""

from __future__ import annotations

import termios

from textual.drivers.linux_driver import LinuxDriver


class TerminalDriver(LinuxDriver):
    """Sets the terminal up again on SIGCONT.

    Textual takes each SIGCONT for the end of a suspension that it has begun itself, at SIGTSTP. It comes without one
    after SIGSTOP, and when the terminal goes away (POSIX.1-2017, 11.1.10 and 2.4.3). Then Textual starts the threads
    that read and write a second time, and never ends the first ones, for which the process waits at its end. That
    happens in the handler, too, where locks of the same thread may be taken.
    """

    def _sigcont_application(self, *args: object) -> None:
        if self._must_signal_resume:
            super()._sigcont_application(*args)
        else:
            self._loop.call_soon_threadsafe(self._set_up_again)

    def _set_up_again(self) -> None:
        try:
            termios.tcgetattr(self.fileno)
        except termios.error:  # it is gone
            return
        if self._app.is_running:
            self.suspend_application_mode()
            self.resume_application_mode()
            self._app.refresh(layout=True)
