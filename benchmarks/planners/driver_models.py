"""Reference drivers written from ``docs/reference_drivers.md`` independently of the product, for benches of verdicts.

At every time step each driver returns its desired deceleration from its view of one other road user (:class:`View`).
"""

import math
from dataclasses import dataclass

STEP_S = 0.1
G = 9.81
BRAKES = {"car": (0.774 * G, 0.6), "truck": (5.0, 0.8), "bus": (5.0, 0.8)}
"""Full braking in m/s² by the ego's class, and the time in s until it is reached."""
TOUCH_M = 0.04
"""Least depth of the contacts of a braking driver, as in docs/reference_drivers.md."""


@dataclass
class View:
    """A driver's view of another road user: gap ahead, distance until past it, lateral gap and its rate, speed,
    deceleration.
    """

    gap: float
    past: float
    aside: float
    nearing: float
    speed: float
    slowing: float


class Careful:
    """UN R157's driver, one instance for each other road user."""

    def __init__(self, later: float) -> None:
        self.delay = 0.75 + later
        self.clear()

    def clear(self) -> None:
        """Forget the other road user."""
        self.widest = -math.inf
        self.since: dict[str, float] = {}
        self.decided: float | None = None
        self.followed = False

    def hidden(self, aside: float, gap: float, v: float) -> None:
        """Record that a vehicle at a distance ahead hides the other road user."""
        self.clear()
        self.widest, self.followed = aside, gap <= 2 * v + 1e-9

    def wants(self, t: float, v: float, felt: float, seen: View) -> float:
        """Return the deceleration that it asks for; 0 if it does not brake."""
        del felt
        inside, closing = seen.aside <= 0 and seen.past > 0, v - seen.speed
        if self.decided is not None:
            begun = t - self.decided >= self.delay
            left = seen.past <= 0 or (seen.aside > 0 and seen.nearing <= 0)
            matched = seen.aside <= 0 and closing <= 0 and seen.slowing <= 1.0
            if begun and t - self.decided > self.delay + STEP_S and (left or matched):
                self.clear()
                self.widest = seen.aside
                return 0.0
            return math.inf if begun else 0.0
        self.widest = max(self.widest, seen.aside)
        in_time = seen.nearing > 0 and closing > 0 and seen.aside / seen.nearing <= seen.past / closing
        nearer = self.widest - seen.aside > 0.375 and (seen.aside <= 3.5 or in_time)
        hard = inside and (seen.slowing > 5 or ("hard" in self.since and (closing > 0 or seen.slowing > 0)))
        for name, holds in (("coming", inside or nearer), ("hard", hard), ("slower", inside and closing > 0.1)):
            if holds:
                self.since.setdefault(name, t)
            else:
                self.since.pop(name, None)
        known = {name for name, at in self.since.items() if t - at >= 0.4 - 1e-9}
        gap = max(seen.gap, 0.0)
        if seen.past > 0 and closing > 0:
            close = gap < 2 * v and "hard" in known
            slow = (gap < 2 * v or self.followed) and "slower" in known
            if close or slow or ("coming" in known and gap < 2 * closing):
                self.decided = t
        return 0.0


class Responding:
    """A driver that responds after a time, and is calm again once it has been safe for as long."""

    def __init__(self, later: float) -> None:
        self.response = 0.75 + later
        self.alarmed: float | None = None
        self.calm: float | None = None

    def allowed(self, t: float, asked: float) -> float:
        """Return how much of a requested deceleration the brakes give."""
        if asked > 0:
            self.alarmed = t if self.alarmed is None else self.alarmed
            self.calm = None
            return asked if t - self.alarmed >= self.response - 1e-9 else 0.0
        if self.alarmed is not None:
            self.calm = t if self.calm is None else self.calm
            if t - self.calm >= 0.75 - 1e-9:
                self.alarmed = self.calm = None
        return 0.0


def fuzzy_asks(v: float, felt: float, seen: View) -> float:
    """Return the deceleration that the fuzzy safety model requests."""
    if seen.past <= 0:
        return 0.0
    closing = v - seen.speed
    if seen.aside > 0:
        if closing <= 0 or seen.nearing <= 0:
            return 0.0
        if seen.aside / seen.nearing > seen.past / closing + 0.1:
            return 0.0
    gap, u, tau, b1, b2 = max(seen.gap, 0.0), seen.speed, 0.75, 4.0, 6.0
    if v > u:
        a = max(felt, -b1)
        v1 = v + a * tau
        if v1 < u:
            if gap < (v - u) ** 2 / (2 * abs(felt)):
                return b2
        else:
            near = (v + a * tau / 2 - u) * tau
            safe, unsafe = near + (v1 - u) ** 2 / (2 * b1), near + (v1 - u) ** 2 / (2 * b2)
            if gap < safe:
                return b1 + (b2 - b1) * min(1.0, (safe - gap) / max(safe - unsafe, 1e-12))
    front = max(u, 0.0) ** 2 / 14.0
    safe, unsafe = v * tau + v * v / (2 * b1) - front + 2.0, v * tau + v * v / (2 * b2) - front
    return b1 * min(1.0, max(0.0, (safe - (gap - 2.0)) / (safe - unsafe)))


def rss_asks(v: float, seen: View) -> float:
    """Return full braking if both distances are unsafe."""
    if seen.past <= 0:
        return 0.0
    if seen.aside > 0:
        n = seen.nearing
        if n <= 0 or seen.aside >= 0.3 + (2 * n + 0.75) * 0.75 / 2 + (n + 0.75) ** 2 / 2:
            return 0.0
    u = seen.speed
    own = v * 0.75 + v * v / 8
    safe = own - u * u / 16 if u >= 0 else own - u * 0.75 + u * u / 8
    return math.inf if max(seen.gap, 0.0) < safe else 0.0
