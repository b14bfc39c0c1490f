"""The clock: number of control periods that are due by wall time, and whether the machine keeps up."""

from collections import deque
from collections.abc import Callable

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import require_within

SLOWEST, FASTEST = 0.1, 4.0
"""Least and largest speed, in multiples of real time."""
PATIENCE = 0.25
"""Longest delay that is made up for; the rest of a longer one is skipped and reported [s of wall time]."""
WINDOW = 3.0
"""Length of the window over which the pace is computed [s of wall time]."""


class Clock:
    """Simulated time relative to wall time."""

    def __init__(self, now: Callable[[], float]) -> None:
        """Start now, in real time; `now` returns the wall time [s]."""
        self._now, self._last, self._credit = now, now(), 0.0
        self.speed = 1.0
        """Requested speed of simulated time, in multiples of wall time."""
        self.is_paused = False
        """Whether simulated time is paused."""
        self.given_up = 0
        """Number of control periods that were skipped because the machine was too slow."""
        self._since = self._last
        self._done: deque[tuple[float, int]] = deque()

    def set_speed(self, speed: float) -> None:
        """Set the speed of simulated time, in multiples of wall time."""
        require_within(SLOWEST, FASTEST, "1", speed=speed)
        self.speed = float(speed)
        self._forget()

    def pause(self, is_paused: bool) -> None:
        """Pause or resume simulated time."""
        self.is_paused = is_paused
        self._forget()

    def due(self) -> int:
        """Return the number of control periods that are due now; they count as done."""
        now = self._now()
        passed, self._last = now - self._last, now
        if self.is_paused:
            return 0
        self._credit += self.speed * CONTROL_RATE * passed
        count = int(self._credit)
        self._credit -= count
        most = max(1, round(PATIENCE * CONTROL_RATE * self.speed))
        self.given_up += max(0, count - most)
        count = min(count, most)
        self._done.append((now, count))
        while self._done and self._done[0][0] < now - WINDOW:
            self._since = self._done.popleft()[0]
        return count

    @property
    def wait(self) -> float:
        """Wall time until the next control period is due, as of the last call of `due` [s]."""
        return 1.0 / CONTROL_RATE if self.is_paused else (1.0 - self._credit) / (CONTROL_RATE * self.speed)

    @property
    def pace(self) -> float:
        """Recent speed of simulated time, in multiples of wall time; 0 before any time has passed."""
        passed = self._last - self._since
        return sum(count for _, count in self._done) / (CONTROL_RATE * passed) if passed > 0.0 else 0.0

    @property
    def is_late(self) -> bool:
        """Whether simulated time has recently been more than 3 % slower than the requested speed."""
        return not self.is_paused and self._last - self._since > 0.5 * WINDOW and self.pace < 0.97 * self.speed

    def _forget(self) -> None:
        """Reset the window of the pace after a change of speed."""
        self._last = self._since = self._now()
        self._done.clear()
        self._credit = 0.0
