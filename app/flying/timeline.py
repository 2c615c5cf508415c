"""A flight being edited: keyframes added, moved in time, deleted, given another view; with undo. Pure.

Every edit makes another `Flight`; the earlier ones are kept, so that nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from terrain.camera import Camera
from terrain.flight import Flight, Keyframe

UNDO_STEPS = 200
SAME_S = 5e-4  # times nearer than this are the same: a keyframe there is given the view instead of a twin
SHORTEST_S, LONGEST_S = 0.0, 86400.0


class Timeline:
    """A flight and what it was before.

    Attributes
    ----------
    flight : Flight
    selected : int or None
        The keyframe that edits are about.
    is_changed : bool
        Whether the flight differs from what was opened or saved last.
    """

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.selected: int | None = None
        self._saved = flight
        self._undo: list[Flight] = []
        self._redo: list[Flight] = []
        self._drag: tuple[str, Flight] | None = None

    @property
    def times_s(self) -> list[float]:
        return [key.t_s for key in self.flight.keyframes]

    @property
    def is_changed(self) -> bool:
        return self.flight is not self._saved

    @property
    def can_undo(self) -> bool:
        return bool(self._undo)

    @property
    def can_redo(self) -> bool:
        return bool(self._redo)

    def mark_saved(self, flight: Flight) -> None:
        """The flight as it is now is on disk, as ``flight`` (which may have another name)."""
        self.flight = self._saved = flight

    def add(self, t_s: float, camera: Camera) -> int:
        """A keyframe at a time; one that is there already is given the view instead. Returns its index."""
        t_s = _clamped(t_s)
        keys = list(self.flight.keyframes)
        near = min(range(len(keys)), key=lambda i: abs(keys[i].t_s - t_s))
        if abs(keys[near].t_s - t_s) < SAME_S:
            return self.update(near, camera)
        index = sum(key.t_s <= t_s for key in keys)
        self._change([*keys[:index], Keyframe(t_s, camera), *keys[index:]])
        self.selected = index
        return index

    def move(self, index: int, t_s: float, dragging: bool = False) -> int:
        """Give a keyframe another time, past others if need be. Returns its new index.

        While ``dragging``, all moves are one step of undo, and start from where the drag began; `drop` ends it.
        """
        tag = f"move {index}"
        if dragging and (self._drag is None or self._drag[0] != tag):
            self._drag = (tag, self.flight)
        start = self._drag[1] if dragging and self._drag is not None else self.flight
        keys = list(start.keyframes)
        moved = replace(keys.pop(index), t_s=_clamped(t_s))
        place = sum(key.t_s < moved.t_s or (key.t_s == moved.t_s and i < index) for i, key in enumerate(keys))
        self._change([*keys[:place], moved, *keys[place:]], start if dragging else None)
        self.selected = place
        return place

    def drop(self) -> None:
        """The mouse let go: the next drag is another step of undo."""
        self._drag = None

    def delete(self, index: int) -> bool:
        """Take a keyframe away; False for the last one left, which a flight needs."""
        keys = list(self.flight.keyframes)
        if len(keys) < 2:
            return False
        del keys[index]
        self._change(keys)
        self.selected = None
        return True

    def update(self, index: int, camera: Camera) -> int:
        """Give a keyframe another view."""
        keys = list(self.flight.keyframes)
        keys[index] = replace(keys[index], camera=camera)
        self._change(keys)
        self.selected = index
        return index

    def stretch(self, duration_s: float) -> None:
        """Make the whole flight last ``duration_s``, all times in proportion."""
        keys, now_s = self.flight.keyframes, self.flight.duration_s
        if now_s <= 0.0 or not 0.0 < duration_s <= LONGEST_S:
            return
        times = [key.t_s / now_s * duration_s for key in keys[:-1]] + [duration_s]
        self._change([replace(key, t_s=min(t, duration_s)) for key, t in zip(keys, times, strict=True)])

    def restart(self, flight: Flight) -> None:
        """Edit another flight; undo leads back to this one."""
        self._push(self.flight)
        self.flight, self.selected = flight, None

    def undo(self) -> None:
        """Take the last edit back."""
        if self._undo:
            self._redo.append(self.flight)
            self._show(self._undo.pop())

    def redo(self) -> None:
        """Do again what was taken back."""
        if self._redo:
            self._undo.append(self.flight)
            self._show(self._redo.pop())

    def _show(self, flight: Flight) -> None:
        self.flight, self._drag = flight, None
        if self.selected is not None and self.selected >= len(flight.keyframes):
            self.selected = None

    def _change(self, keys: Sequence[Keyframe], start: Flight | None = None) -> None:
        """Take over edited keyframes; with ``start`` the edit goes on that began there."""
        if start is None:
            self._push(self.flight)
            self._drag = None
        elif not self._undo or self._undo[-1] is not start:
            self._push(start)
        self.flight = replace(self.flight, keyframes=tuple(keys))

    def _push(self, flight: Flight) -> None:
        self._undo = [*self._undo[1 - UNDO_STEPS :], flight]
        self._redo = []


def _clamped(t_s: float) -> float:
    return min(max(t_s, SHORTEST_S), LONGEST_S)
