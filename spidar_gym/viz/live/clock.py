"""The clock: how many control periods are due by the wall, and whether the machine keeps up."""

from collections import deque
from collections.abc import Callable

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.errors import require_within

SLOWEST, FASTEST = 0.1, 4.0
"""Times real time that may be asked for."""
PATIENCE = 0.25
"""A delay up to this is made up for; of a longer one the rest is given up, and said [s of the wall]."""
WINDOW = 3.0
"""The pace is that of so many last seconds [s]."""


class Clock:
    """Simulated time beside the wall's."""

    def __init__(self, now: Callable[[], float]) -> None:
        """Begin now, in real time; `now` is the wall's time [s]."""
        self._now, self._last, self._credit = now, now(), 0.0
        self.speed = 1.0
        """How many times as fast as the wall's simulated time is to pass."""
        self.is_paused = False
        """Whether it stands still."""
        self.given_up = 0
        """Control periods that the machine had no time for, and that nobody flew."""
        self._since = self._last
        self._done: deque[tuple[float, int]] = deque()

    def set_speed(self, speed: float) -> None:
        """Have simulated time pass so many times as fast as the wall's."""
        require_within(SLOWEST, FASTEST, "1", speed=speed)
        self.speed = float(speed)
        self._forget()

    def pause(self, is_paused: bool) -> None:
        """Have time stand still, or go on."""
        self.is_paused = is_paused
        self._forget()

    def due(self) -> int:
        """How many control periods are to be flown now; they count as flown."""
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
        """Seconds of the wall until the next control period is due, as of the last look."""
        return 1.0 / CONTROL_RATE if self.is_paused else (1.0 - self._credit) / (CONTROL_RATE * self.speed)

    @property
    def pace(self) -> float:
        """How many times as fast as the wall's simulated time has passed of late; 0 before anything did."""
        passed = self._last - self._since
        return sum(count for _, count in self._done) / (CONTROL_RATE * passed) if passed > 0.0 else 0.0

    @property
    def is_late(self) -> bool:
        """Whether it passes more slowly than it is to, by more than the odd delay."""
        return not self.is_paused and self._last - self._since > 0.5 * WINDOW and self.pace < 0.97 * self.speed

    def _forget(self) -> None:
        """What has passed was at another speed."""
        self._last = self._since = self._now()
        self._done.clear()
        self._credit = 0.0
