"""Which windows are open, and which one is asked for; kept for the next run. Where they lie is ImGui's affair."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.session.session import Session


class Layout:
    """The windows of a session, by the names they have in `app.windows.table`.

    Attributes
    ----------
    open : dict
        Whether each window is open, also while all are hidden.
    raised : str
        The window to be shown before those that share its place; empty for none.
    shows_windows : bool
        Whether windows are shown at all.
    shows_help : bool
    wants_first : bool
        Whether all windows are to go back to their first places.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.open = dict(session.preferences.current.open_windows)
        self.raised = ""
        self.shows_windows, self.shows_help, self.wants_first = True, False, False

    def is_open(self, name: str) -> bool:
        """Whether a window is open, and windows are shown."""
        return self.shows_windows and self.open.get(name, False)

    def show(self, name: str, is_open: bool = True) -> None:
        """Open or close a window, also in the next run."""
        self.shows_windows = True
        self.open[name] = is_open
        if is_open:
            self.raised = name
        self._session.preferences.change(open_windows=dict(self.open))

    def toggle(self, name: str) -> None:
        """Open or close a window."""
        self.show(name, not self.is_open(name))

    def toggle_windows(self) -> None:
        """Hide all windows, so that only the picture is left, or show them again."""
        self.shows_windows = not self.shows_windows

    def toggle_help(self) -> None:
        """Show or hide all keys."""
        self.shows_help = not self.shows_help

    def reset(self) -> None:
        """Put all windows back where they were at first."""
        self.shows_windows = self.wants_first = True
