"""On which level a pedestrian with a barometer is, and by which way they came there: stairs, lift or escalator.

Pressure falls by 0.12 hPa a metre, and by as much within minutes of weather, or at once when a door opens. Three things
part a change of level from these: people rise no faster than stairs and lifts carry them, no pedestrian on foot climbs
like a lift, and who walks on at one height stands on the floor of a level.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final, Literal, NamedTuple, get_args

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray

Way = Literal["unknown", "stairs", "lift", "escalator"]
WAYS: Final[tuple[Way, ...]] = get_args(Way)
SCALE_HEIGHT_M: Final = 8435.0  # R T / (g M) of the standard atmosphere at 15 degrees Celsius
TICK_S: Final = 0.25  # heights are decided on so often
STEPS_ON_STAIRS_HZ: Final = 0.7  # who takes fewer is carried
WALKED_MPS: Final = 0.6  # faster than people climb: who walks then does so on an escalator
CARRIED_MPS: Final = 0.55  # escalators rise by 0.25 to 0.38 m/s (0.5 to 0.75 m/s at 30 degrees), lifts by 0.6 and more
TURNED_M: Final = 0.5  # on top of the margin, for a change back before a level was reached
MAX_GAP_S: Final = 3.0  # in a longer gap anybody may have taken a lift
PRESSURE_HPA: Final = (300.0, 1260.0)  # from the top of Everest to where sensors end; other rows are left out


def level_heights(building: Building) -> dict[int, float]:
    """Height of each level: the median of its floor polygons, weighed by area; stairs and lifts do not count."""
    heights: dict[int, float] = {}
    for level in building.levels:
        own = sorted((p.height_m, p.area_m2) for p in building.polygons if p.level == level and p.kind == "floor")
        if own:
            area_m2 = np.cumsum([area for _, area in own])
            heights[level] = own[int(np.searchsorted(area_m2, area_m2[-1] / 2))][0]
    return heights


@dataclass(frozen=True, slots=True)
class VerticalParams:
    """Settings of `LevelTracker`; ours unless a line says otherwise.

    Attributes:
        median_s: Pressure is the median of so long, which takes out noise and keeps the edge of a door that opens.
        stairs_mps: Vertical speed of a walking pedestrian; what is faster is a change of the air.
        lift_mps: Vertical speed of a standing pedestrian.
        surge_mps: By how much a speed may exceed the mean of the last second: lifts start and stop gently.
        steps_s: Who made no step for so long stands.
        flat_s: Over so long, a height that changes by less than `flat_m` is that of a level, or of a landing.
        flat_m: See there.
        settle_s: Time constant with which a constant height becomes the height of the level.
        near: Fraction of the distance of levels, within which it does so at once.
        floor_steps: Beyond, only after so many steps at one height: more than a landing takes.
        lead_s: On stairs and escalators, the height is taken to go on for so long as in the last seconds: medians lag.
        margin_m: Past the middle between two levels, before the upper or lower one counts.
        spacing_m: Between levels whose heights are not known; then they are learned.
    """

    median_s: float = 1.0
    stairs_mps: float = 0.8  # two treads of 0.17 m at 2.2 steps a second
    lift_mps: float = 3.0
    surge_mps: float = 0.75  # lifts accelerate by 1 m/s2 at most, and the mean of a second lags by half of it
    steps_s: float = 1.5
    flat_s: float = 4.0
    flat_m: float = 0.35
    settle_s: float = 12.0
    near: float = 0.35
    floor_steps: int = 12
    lead_s: float = 1.5
    margin_m: float = 0.15
    spacing_m: float = 4.0  # between 2.7 m of homes and 5.8 m of halls, in ratio

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0 < value < math.inf:
                raise PdrbenchError(f"levels from pressure: {name} must be positive; got {value!r}")


class LevelChange(NamedTuple):
    """One level up or down, at the time when the middle between the two is passed."""

    t_s: float  # time
    levels: int  # +1 or -1; more where pressure was missing on the way
    rise_m: float  # height of the new level above the old one
    way: Way  # how, as far as it is known then


class LevelTracker:
    """Follows the level by pressure and steps, causally; any chunks of the rows give the same answers.

    Heights move with the pressure as far as people can; what is left of a change, and what comes slowly while the
    pedestrian is at one height, is weather and doors, and goes into an offset.

    Args:
        level: On which it begins.
        heights_m: Height of each level, as `level_heights` has them; None: every level is possible, and its height is
            learned when the pedestrian walks on it.
        params: None for the defaults.

    Attributes:
        level: Now.
        way: How the pedestrian moves up or down now; None at one height.
    """

    def __init__(
        self, level: int = 0, heights_m: Mapping[int, float] | None = None, params: VerticalParams | None = None
    ) -> None:
        self._params = params or VerticalParams()
        self._known = {level: 0.0} if heights_m is None else dict(heights_m)
        if level not in self._known:
            raise PdrbenchError(
                f"levels from pressure: no height is given for level {level}, where it begins; "
                f"known are {', '.join(map(str, sorted(self._known)))}"
            )
        self._learns = heights_m is None
        self.level = level
        self.way: Way | None = None
        self._z_m = self._known[level]
        self._rows: deque[tuple[float, float]] = deque()  # pressures of the last `median_s`
        self._steps_s: deque[float] = deque()  # of the last seconds, and those still to come
        self._num_steps = 0
        self._tick_s, self._before_hpa = -math.inf, math.nan
        # Of the last `flat_s`: time and height; since when there is no rest, from which height, after how many steps.
        self._path: deque[tuple[float, float]] = deque()
        self._left: tuple[float, float, int] = (0.0, self._z_m, 0)
        self._flat_from_step = 0
        self._going = 0  # direction of the last change, until a level is reached

    @property
    def height_m(self) -> float:
        """Of the feet, in the frame of the heights given, or above the start."""
        return self._z_m

    def update(self, baro: FloatArray, steps_s: FloatArray) -> list[LevelChange]:
        """Takes the next rows and gives the changes of level that became known.

        Args:
            baro: (n, 2) t_s, pressure in hPa.
            steps_s: (k,) times of the steps that have become known meanwhile, of a `PeakStepDetector` as an example.
        """
        self._steps_s.extend(np.asarray(steps_s, dtype=np.float64).tolist())
        changes: list[LevelChange] = []
        for t_s, pressure_hpa in np.asarray(baro, dtype=np.float64).tolist():
            if not PRESSURE_HPA[0] <= pressure_hpa <= PRESSURE_HPA[1] or not math.isfinite(t_s):
                continue
            self._rows.append((t_s, pressure_hpa))
            while self._rows[0][0] <= t_s - self._params.median_s:
                self._rows.popleft()
            if t_s - self._tick_s >= TICK_S - 1e-6:
                self._tick(t_s, changes)
        return changes

    def _tick(self, t_s: float, changes: list[LevelChange]) -> None:
        step_s = t_s - self._tick_s
        self._tick_s = t_s
        values = sorted(pressure_hpa for _, pressure_hpa in self._rows)
        now_hpa = (values[len(values) // 2] + values[(len(values) - 1) // 2]) / 2
        before_hpa, self._before_hpa = self._before_hpa, now_hpa
        if math.isnan(before_hpa):
            self._path.append((t_s, self._z_m))
            self._left = (t_s, self._z_m, 0)
            return
        walks = self._count_steps(t_s)
        self._rise(SCALE_HEIGHT_M * math.log(before_hpa / now_hpa), step_s, walks)
        is_flat = self._is_flat(t_s)
        if is_flat:
            self._settle(step_s)
            self._left, self.way, self._going = (t_s, self._z_m, self._num_steps), None, 0
        else:
            self._flat_from_step = self._num_steps
            self.way = self._way(t_s)
        self._decide(t_s, changes)

    def _count_steps(self, t_s: float) -> bool:
        """Whether the pedestrian walks now; counts the steps up to now."""
        recent = [step_s for step_s in self._steps_s if step_s <= t_s]
        while self._steps_s and self._steps_s[0] <= t_s - self._params.steps_s:
            self._steps_s.popleft()
            self._num_steps += 1
        return bool(recent) and recent[-1] > t_s - self._params.steps_s

    def _rise(self, rise_m: float, step_s: float, walks: bool) -> None:
        """As much of a change of pressure as a person can rise."""
        p = self._params
        fastest_m = p.lift_mps * step_s
        if step_s <= MAX_GAP_S:
            then_s, then_m = next((row for row in self._path if row[0] > self._tick_s - 1.0 - TICK_S), self._path[-1])
            past_mps = abs(self._z_m - then_m) / max(self._tick_s - step_s - then_s, TICK_S)
            fastest_m = min(p.stairs_mps if walks else p.lift_mps, past_mps + p.surge_mps) * step_s
        self._z_m += min(max(rise_m, -fastest_m), fastest_m)

    def _is_flat(self, t_s: float) -> bool:
        """Whether the height of the last seconds is one."""
        self._path.append((t_s, self._z_m))
        while len(self._path) > 1 and self._path[1][0] <= t_s - self._params.flat_s:
            self._path.popleft()
        begin_m = self._path[0][1]
        return abs(self._z_m - begin_m) < self._params.flat_m

    def _settle(self, step_s: float) -> None:
        """Moves the offset so that the height becomes that of the level, or learns the height of the level."""
        p = self._params
        error_m = self._z_m - self._height(self.level)
        is_floor = self._num_steps - self._flat_from_step >= p.floor_steps
        if self._learns and is_floor and self.level not in self._known:
            self._known[self.level] = self._z_m
            return
        above, below = self._height(self.level + 1), self._height(self.level - 1)
        spacing_m = min(abs(above - self._height(self.level)), abs(self._height(self.level) - below))
        if self.level in self._known and (is_floor or abs(error_m) < p.near * spacing_m):
            moved_m = error_m * min(step_s / p.settle_s, 1.0)
            self._z_m -= moved_m
            self._path = deque((row_s, row_m - moved_m) for row_s, row_m in self._path)

    def _decide(self, t_s: float, changes: list[LevelChange]) -> None:
        """The level nearest in height, once the middle is passed by a margin."""
        z_m, margin_m, levels = self._z_m, self._params.margin_m, 0
        speed_mps = self._speed_mps(t_s, 2.0)
        if self.way in ("stairs", "escalator") and speed_mps * self._going >= 0:
            z_m += self._params.lead_s * speed_mps
        direction = 1 if z_m > self._height(self.level) else -1
        if direction == -self._going:
            margin_m += TURNED_M
        own_m = abs(z_m - self._height(self.level))
        while self._exists(self.level + levels + direction):
            other_m = abs(z_m - self._height(self.level + levels + direction))
            if other_m + 2 * margin_m > own_m:
                break
            levels, own_m = levels + direction, other_m
        if levels:
            rise_m = self._height(self.level + levels) - self._height(self.level)
            changes.append(LevelChange(t_s, levels, rise_m, self.way or "unknown"))
            self.level += levels
            self._going = direction

    def _speed_mps(self, t_s: float, over_s: float) -> float:
        """Mean vertical speed of the last seconds."""
        then_s, then_m = next(row for row in self._path if row[0] >= t_s - over_s - 1e-6)
        return (self._z_m - then_m) / max(t_s - then_s, 1.0)

    def _exists(self, level: int) -> bool:
        return self._learns or min(self._known) <= level <= max(self._known)

    def _height(self, level: int) -> float:
        """Of a level; one that is not known is `spacing_m` from the next one that is."""
        if level in self._known:
            return self._known[level]
        nearest = min(self._known, key=lambda known: abs(known - level))
        return self._known[nearest] + (level - nearest) * self._params.spacing_m

    def _way(self, t_s: float) -> Way:
        """By speed and steps since the last moment at one height."""
        left_s, left_m, steps = self._left
        since_s, rise_m = t_s - left_s, abs(self._z_m - left_m)
        if since_s < 1.0 or rise_m < 0.5:
            return self.way or "unknown"
        walked = sum(1 for step_s in self._steps_s if step_s <= t_s) + self._num_steps - steps
        if walked / since_s > STEPS_ON_STAIRS_HZ:
            return "stairs" if rise_m / since_s < WALKED_MPS else "escalator"
        fastest_mps = max(rise_m / since_s, abs(self._speed_mps(t_s, 1.5)))
        return "lift" if fastest_mps > CARRIED_MPS else "escalator"
