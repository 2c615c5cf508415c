"""What is going on, for the status line: each job says how far it is and how to stop it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from terrain.errors import InputError

# What work that cannot be done raises: bad input, too little memory, what a driver or an array library refuses.
FAILURES = (InputError, MemoryError, RuntimeError, ValueError)


@dataclass(eq=False)
class Job:
    """Something that takes a while.

    Attributes
    ----------
    name : str
        What happens: ``"Reading alps.tif"``.
    how_to_stop : str
        ``"Escape cancels, what is written stays"``.
    share : float or None
        How much is done, 0 to 1; None where nobody knows.
    stop : callable or None
        Stops it: for Escape and the button in the status line.
    """

    name: str
    how_to_stop: str
    share: float | None = None
    stop: Callable[[], None] | None = None

    def __str__(self) -> str:
        share = "" if self.share is None else f" {100.0 * self.share:.0f} %"
        return f"{self.name}{share}: {self.how_to_stop}."


class Jobs:
    """The jobs that run now, the newest last."""

    def __init__(self) -> None:
        self._running: list[Job] = []
        self._announced: list[tuple[Job, Callable[[], object]]] = []
        self._due: list[tuple[Job, Callable[[], object]]] = []

    def begin(self, name: str, how_to_stop: str, stop: Callable[[], None] | None = None) -> Job:
        """A new job; who began it sets its share and ends it."""
        job = Job(name, how_to_stop, stop=stop)
        self._running.append(job)
        return job

    def end(self, job: Job | None) -> None:
        """Take a job from the list; nothing where it has ended before."""
        self._running = [other for other in self._running if other is not job]

    def announce(self, name: str, act: Callable[[], object]) -> None:
        """Do something that keeps the window waiting, once the status line has said so."""
        self._announced.append((self.begin(name, "the window waits for it"), act))

    def work(self) -> None:
        """Called once a frame: do what was announced a frame ago."""
        due, self._due, self._announced = self._due, self._announced, []
        for job, act in due:
            act()
            self.end(job)

    def stop_newest(self) -> bool:
        """Stop the newest job that can be stopped; whether there was one."""
        for job in reversed(self._running):
            if job.stop is not None:
                job.stop()
                return True
        return False

    def __iter__(self) -> Iterator[Job]:
        return iter(tuple(self._running))

    def __len__(self) -> int:
        return len(self._running)


def reason(error: Exception) -> str:
    """Why something could not be done, in words; not all that fails says so itself."""
    return str(error) or ("too little memory" if isinstance(error, MemoryError) else type(error).__name__)
