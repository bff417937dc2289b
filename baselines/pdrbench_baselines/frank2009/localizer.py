"""Frank, Krach, Catterall & Robertson 2009: WLAN fingerprints and a shoe, fused in two layers (claims F4 to F14).

`wlan_frank2009` is their fingerprinting alone, `frank2009` the cascade. Neither looks at the map (F14).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import DETECTORS, LITERAL, FootParams
from pdrbench.inertial.magnetometer import FieldParams
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import middle_of_survey
from pdrbench.recording import RadioMap, SensorSpec
from pdrbench.trajectory import Start
from pdrbench_baselines.frank2009.ekf import Belief, predict, turned, update
from pdrbench_baselines.frank2009.histograms import HistogramTable, best_of_three
from pdrbench_baselines.frank2009.step_sensor import FootSteps, StepSensorParams, VirtualSteps

ANY_HEADING_RAD: Final = math.pi / math.sqrt(3)  # standard deviation of a heading of which nothing is known
LOWER: Final = replace(LITERAL, detector=DETECTORS["interval"], field=FieldParams())  # F6, F7
NORTH_RAD: Final = math.pi / 2  # magnetic north in the building frame, as far as is known


@dataclass(frozen=True, slots=True)
class FingerprintingParams:
    """Settings of the fingerprinting; the paper has none of them.

    Attributes:
        survey_age_s: Older readings of the survey were received somewhere else.
        scan_age_s: Older readings are of an earlier scan. The paper's scanner repeats nothing.
        votes: Whether the best of three is answered (F5) or each scan's own point.
        unknown: How an access point of the scan counts that a fingerprint lacks: "penalise" as one of -100 dBm there,
            or "ignore" as eq. (1) says to the letter (F4): fingerprints of few access points are then near to every
            scan. Val walks of simulated and recorded surveys and the replica of the paper are all worse with it.
    """

    survey_age_s: float = 12.0  # as `wifi_knn`; chosen on the train walks of MallPhoneLost-v2
    scan_age_s: float = 4.0  # ours: a sweep of a phone, and its delivery
    votes: bool = True
    unknown: Literal["ignore", "penalise"] = "penalise"


@dataclass(frozen=True, slots=True)
class Frank2009Params:
    """Settings of the cascade; the paper gives no number.

    Attributes:
        wlan: Of the fingerprinting.
        lower: Of the lower filter: nine states, rest phases by an interval (F6), magnetometer (F7).
        sensor: Of the step sensor.
        step_sigma_m: Noise of a step along each axis of the building (F9).
        step_heading_sigma_rad: Noise of its change of heading (F9).
        wlan_sigma_m: Noise of a WLAN place along each axis (F10).
        start_sigma_m: Of the first place, where WLAN gives it (F12).
        compass_sigma_rad: Of the first heading, where a magnetometer gives it (F12).
        compass_wait_s: Steps are not used before the magnetometer has been read, for so long at most.
        start_known_sigma_m: Of a start from the briefing that is surveyed.
        heading_known_sigma_rad: Of a heading from the briefing.
        degrees: Of freedom of the Student law of WLAN errors; infinite as in the paper. With 3, one place that is far
            off moves the filter little.
    """

    wlan: FingerprintingParams = field(default_factory=FingerprintingParams)
    lower: FootParams = LOWER
    sensor: StepSensorParams = field(default_factory=StepSensorParams)
    step_sigma_m: float = 0.10  # F9
    step_heading_sigma_rad: float = math.radians(2.0)  # F9
    wlan_sigma_m: float = 3.0  # F10
    start_sigma_m: float = 3.0  # F12
    compass_sigma_rad: float = math.radians(30.0)  # F12
    compass_wait_s: float = 5.0  # ours
    start_known_sigma_m: float = 0.5  # ours
    heading_known_sigma_rad: float = math.radians(10.0)  # ours
    degrees: float = math.inf


WLAN: Final = FingerprintingParams()
CASCADE: Final = Frank2009Params()


class HistogramMatcher:
    """Scans in, calibration points out.

    Args:
        radio_map: The survey.
        wifi: What the columns of a scan are.
        params: See `FingerprintingParams`.
    """

    def __init__(self, radio_map: RadioMap, wifi: SensorSpec, params: FingerprintingParams) -> None:
        self._params = params
        self.table = HistogramTable.from_radio_map(radio_map, max_age_s=params.survey_age_s)
        self._columns = [wifi.index(name) for name in ("t_s", "access_point", "rssi_dbm", "age_s")]
        self._nearest_points: deque[int] = deque(maxlen=3)
        self._last_s = -math.inf
        self.point: int | None = None

    def update(self, rows: FloatArray) -> list[tuple[float, int]]:
        """Time of each scan among the next rows, and the calibration point to answer with from then on.

        Scans are taken in the order of their times. One that is not later than the last one, is of no access point that
        the survey knows, or only repeats older readings, has none: the last answer is kept.
        """
        found = []
        for t_s in sorted(set(rows[:, 0].tolist())):
            if t_s <= self._last_s:
                continue
            self._last_s = t_s
            point = self._nearest(rows[rows[:, 0] == t_s][:, self._columns])
            if point is not None:
                self._nearest_points.append(point)
                self.point = best_of_three(self._nearest_points) if self._params.votes else point
                found.append((t_s, self.point))
        return found

    def _nearest(self, readings: FloatArray) -> int | None:
        """Of (n, 4) time, access point, RSSI, age; eq. (1) and its minimum."""
        readings = readings[readings[:, 3] <= self._params.scan_age_s]
        if not self.table.known(readings[:, 1]).any():
            return None
        return int(np.argmin(self.table.distance(readings[:, 1], readings[:, 2], unknown=self._params.unknown)))

    def middle(self) -> Start:
        """Of the calibration points."""
        return middle_of_survey(self.table.xy_m, self.table.level)


class WlanFrank2009:
    """Answers the calibration point whose histograms are nearest to the scan, by the best of three scans.

    Before the first scan it answers the start, where one is given, else the middle of the survey.

    Args:
        params: See `FingerprintingParams`.
    """

    def __init__(self, params: FingerprintingParams = WLAN) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("wifi",), radio_map=True)
        assert briefing.radio_map is not None
        self._wlan = HistogramMatcher(briefing.radio_map, briefing.sensors["wifi"], self._params)
        start = briefing.start or self._wlan.middle()
        self._estimate = Estimate(xy_m=start.xy_m, level=start.level)

    def step(self, observation: Observation) -> Estimate:
        for _, point in self._wlan.update(observation["wifi"]):
            table = self._wlan.table
            self._estimate = Estimate(xy_m=table.xy_m[point], level=int(table.level[point]))
        return self._estimate


class Frank2009:
    """Steps of a shoe, fused with WLAN places in an extended Kalman filter.

    The first place is that of the first scan, unless the briefing has a better known start; the first heading is that
    of the magnetometer, or of the briefing; with neither, any. The level is that of the last fingerprint.

    Args:
        params: See `Frank2009Params`.
    """

    def __init__(self, params: Frank2009Params = CASCADE) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("accel", "gyro", "wifi"), radio_map=True, carrier="foot")
        assert briefing.radio_map is not None
        self._wlan = HistogramMatcher(briefing.radio_map, briefing.sensors["wifi"], self._params.wlan)
        self._has_compass = "mag" in briefing.sensors
        lower = self._params.lower if self._has_compass else replace(self._params.lower, field=None)
        self._steps = FootSteps(briefing.sensors["accel"].rate_hz or 100.0, lower, self._params.sensor)
        self._belief: Belief | None = None
        self._nis: list[float] = []
        given, start = briefing.start, briefing.start or self._wlan.middle()
        self._level, self._first_xy_m, self._has_given_heading = start.level, start.xy_m, False
        if given is not None and given.radius_m < 2 * self._params.start_sigma_m:
            sigma_m = max(given.radius_m / 2, self._params.start_known_sigma_m)
            self._has_given_heading = given.heading_rad is not None
            self._belief = self._begin(given.xy_m, sigma_m, given.heading_rad)

    def step(self, observation: Observation) -> Estimate:
        rows = {name: observation[name] for name in ("accel", "gyro", *(["mag"] if self._has_compass else []))}
        steps = self._steps.update(rows)
        fixes = self._wlan.update(observation["wifi"])
        events = [(float(t_s), 0, k) for k, t_s in enumerate(steps.known_s)]
        events += [(t_s, 1, k) for k, (t_s, _) in enumerate(fixes)]
        for now_s, is_fix, k in sorted(events):
            if is_fix:
                self._fix(now_s, fixes[k][1])
            elif self._belief is not None:
                self._walk(self._belief, steps, k)
        return self._estimate()

    def debug(self) -> dict[str, Any]:
        """The normalised innovation squared of every WLAN place so far (F10), and the misalignment (F8)."""
        return {"nis": np.array(self._nis), "misalignment_rad": self._steps.sensor.misalignment_rad}

    def _walk(self, belief: Belief, steps: VirtualSteps, k: int) -> None:
        """Eq. (13), (14)."""
        p = self._params
        sigma = np.array([p.step_sigma_m, p.step_sigma_m, p.step_heading_sigma_rad])
        misalignment_change_rad = float(steps.misalignment_change_rad[k])
        if self._has_given_heading and misalignment_change_rad:
            # A given heading is the pedestrian's: it has the first misalignment in it.
            self._has_given_heading, misalignment_change_rad = False, 0.0
        self._belief = predict(turned(belief, misalignment_change_rad), steps.step[k], sigma)

    def _fix(self, now_s: float, point: int) -> None:
        """Eq. (18) to (22), or the first place."""
        xy_m = self._wlan.table.xy_m[point]
        self._level = int(self._wlan.table.level[point])
        if self._belief is None:
            self._first_xy_m = xy_m
            is_due = not self._has_compass or self._steps.field_rad is not None or now_s >= self._params.compass_wait_s
            if is_due:
                self._belief = self._begin(xy_m, self._params.start_sigma_m, None)
            return
        self._belief, nis = update(self._belief, xy_m, self._params.wlan_sigma_m, self._params.degrees)
        self._nis.append(nis)

    def _begin(self, xy_m: FloatArray, sigma_m: float, given_rad: float | None) -> Belief:
        """The first belief (F12); the heading of the lower filter's world frame is that of its x axis."""
        field_rad = self._steps.field_rad
        if given_rad is not None:
            heading_rad, sigma_rad = given_rad, self._params.heading_known_sigma_rad
        elif field_rad is not None:
            heading_rad = NORTH_RAD - field_rad + self._steps.sensor.heading_rad
            sigma_rad = self._params.compass_sigma_rad
        else:
            heading_rad, sigma_rad = 0.0, ANY_HEADING_RAD
        return Belief(np.array([*xy_m, heading_rad]), np.diag(np.square([sigma_m, sigma_m, sigma_rad])))

    def _estimate(self) -> Estimate:
        belief = self._belief
        if belief is None:
            return Estimate(xy_m=self._first_xy_m, level=self._level)
        return Estimate(belief.mean[:2].copy(), self._level, float(belief.mean[2]), belief.sigma_m)
