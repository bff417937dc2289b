"""`gp_wifi`: a Bayes filter on a lattice over all levels, with a radio map that extrapolates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from scipy.ndimage import gaussian_filter

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import middle_of_survey
from pdrbench_baselines.gp_wifi.field import SignalFieldParams, SignalMap
from pdrbench_baselines.gp_wifi.fingerprints import FingerprintEvidence, FingerprintParams
from pdrbench_baselines.gp_wifi.kernels import add_readings, log1p_exp_table
from pdrbench_baselines.gp_wifi.sightings import Sweeps

STRONG_DBM = -60.0  # a reading counts in full there
SILENT_DBM = -100.0  # and not at all there
LOG1P_EXP: Final = log1p_exp_table()
USUAL_DBM = -85.0  # of what is received where the survey does not let expect it, and no stronger mostly


@dataclass(frozen=True, slots=True)
class GpWifiParams:
    """Ours; chosen on train walks of MallPhoneLost-v2 whose sessions were left out of the survey.

    Attributes:
        fingerprints: Of a survey whose places were interpolated.
        field: Of the radio map.
        trust: Power of the likelihood of a reading of `STRONG_DBM`: access points of a phone err alike.
        power: Of the strength above `SILENT_DBM`, by which that falls for weaker readings.
        unexpected: Density per dB at which an access point is received where none is expected.
        unexpected_db: By which that falls to 1 / e above `USUAL_DBM`.
        offset_sigma_db: Spread of the offsets of devices; 0 for none.
        speed_mps: A place spreads by so much per second, per axis.
        lost_fraction: Of the belief that is spread over all levels at every scan.
        start_sigma_m: Around a known start, at least.
        fingerprint_trust: Power of the density of a scan by its nearest fingerprints. Chosen with the next on val walks
            of MallPhoneLost-v2 and CampusPhoneLost-v1; where the start is known and places of the survey were
            interpolated it is 0: there, on MallPhone-v2, fields alone were better.
        min_level: Fields of a level on which less belief is left are not asked.
        answer_m: Belief farther than about that from where most of it lies does not move the answer; infinite for the
            mean of all of it. Chosen on val walks of five sets, each left out in turn.
    """

    fingerprints: FingerprintParams = field(default_factory=FingerprintParams)
    field: SignalFieldParams = field(default_factory=SignalFieldParams)
    trust: float = 0.1
    power: float = 2.0
    unexpected: float = 1e-3
    unexpected_db: float = 8.0
    offset_sigma_db: float = 3.0
    speed_mps: float = 1.0
    lost_fraction: float = 0.003
    start_sigma_m: float = 2.0
    fingerprint_trust: float = 0.3
    min_level: float = 1e-3
    answer_m: float = 30.0

    def offsets_db(self) -> tuple[FloatArray, FloatArray]:
        """(K,) offsets, and their prior."""
        offset_db = self.offset_sigma_db * np.linspace(-2.0, 2.0, 5 if self.offset_sigma_db else 1)
        offset_db = offset_db if self.offset_sigma_db else np.zeros(1)
        prior = np.exp(-0.5 * (offset_db / (self.offset_sigma_db or 1.0)) ** 2)
        return offset_db, prior / prior.sum()

    def log_likelihood(
        self,
        places: SignalMap,
        numbers: Sequence[int],
        access_points: IntArray,
        rssi_dbm: list[float],
        offset_db: FloatArray,
    ) -> FloatArray:
        """(n, K) of readings at the places of some levels, by their numbers, with offsets (K,), up to a constant.

        A reading counts by the logarithm of how much likelier it is where it is expected than where it is not.
        """
        strengths, which = np.unique(rssi_dbm, return_inverse=True)  # few: whole numbers, mostly
        readings = np.array([(dbm, self.odds_of(dbm), self.trust_of(dbm)) for dbm in strengths.tolist()])
        readings = readings.reshape(-1, 3)[which]
        found = [np.zeros((size, len(offset_db))) for size in np.diff(places.first)[numbers]]
        for number, part in zip(numbers, found, strict=True):
            fields = places.prepare(access_points, number)
            own = {which: one for which, one in enumerate(fields) if one is not None and len(one.at)}
            if own:
                at, mean_dbm, variance_db2 = map(np.concatenate, zip(*own.values(), strict=True))
                first = np.cumsum([0, *(len(one.at) for one in own.values())])
                noise_db2 = self.field.noise_db**2
                known = readings[list(own)]
                add_readings(part, at, first, mean_dbm, variance_db2, known, offset_db, noise_db2, LOG1P_EXP)
        return np.concatenate(found)

    def trust_of(self, dbm: float) -> float:
        """Power of the likelihood of a reading."""
        return float(self.trust * (max(dbm - SILENT_DBM, 0.0) / (STRONG_DBM - SILENT_DBM)) ** self.power)

    def odds_of(self, dbm: float) -> float:
        """Probability that a reading is reported over the density per dB at which it comes where none is expected."""
        unexpected = self.unexpected * math.exp(-max(dbm - USUAL_DBM, 0.0) / self.unexpected_db)
        z = (dbm - self.field.half_dbm) / self.field.half_sigma_db
        return self.field.reported * 0.5 * math.erfc(-z / math.sqrt(2.0)) / unexpected


# Chosen on val walks of MallPhoneLost-v2 and CampusPhoneLost-v1; particles of `fusion` from a known start lost by it.
GP_WIFI: Final = GpWifiParams(field=SignalFieldParams(min_information_per_db2=1.5e-3))


class GpWifi:
    """WLAN by Gaussian processes over a survey; answers the mean of belief on the likeliest level, near to its peak.

    The belief is a histogram over the places of the lattice and the offset of the device. Between scans it spreads as
    far as people walk; a scan multiplies it by the likelihood of what was received since the scan before. After one
    scan it may have several peaks far apart, and a mean between these is where nobody is. Before the first scan it
    answers the start, where there is one, else the middle of the survey.

    Args:
        params: See `GpWifiParams`.
    """

    def __init__(self, params: GpWifiParams = GP_WIFI) -> None:
        self._params = params
        self._of: tuple[Any, Any] | None = None

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("wifi",), radio_map=True)
        survey = briefing.radio_map
        assert survey is not None
        if self._of is None or self._of[0] is not survey or self._of[1] is not briefing.building:
            places = self._map = SignalMap(survey, briefing.building, self._params.field)
            wifi, own = briefing.sensors["wifi"], self._params.fingerprints
            self._fingerprints = FingerprintEvidence(survey, wifi, own, places.xy_m, places.level)
            self._of = survey, briefing.building
        self._sweeps = Sweeps()
        self._fingerprints.begin()
        self._offset_db, self._prior = self._params.offsets_db()
        is_helped = briefing.start is None or survey.surveyed
        self._fingerprint_trust = self._params.fingerprint_trust if is_helped else 0.0
        start = briefing.start or middle_of_survey(survey.xy_m, survey.level)
        if briefing.start is None:
            self._map.get_ready()  # now, and not at the first scan: a step is to be quick
        self._belief = self._anywhere()
        if briefing.start is not None:
            self._belief = np.outer(self._map.near(briefing.start, self._params.start_sigma_m), self._prior)
        self._estimate = Estimate(xy_m=start.xy_m, level=start.level)

    def step(self, observation: Observation) -> Estimate:
        rows = observation["wifi"]
        for t_s, fresh, since_s in self._sweeps.update(rows):
            self._spread(since_s)
            for density in self._fingerprints.update(rows[rows[:, 0] == t_s]):
                self._multiply(self._fingerprint_trust * density[:, None])
            self._weigh(fresh[:, 1].astype(np.int64), fresh[:, 2].tolist())
            self._locate()
        return self._estimate

    def debug(self) -> dict[str, Any]:
        """The lattice and the belief there, the mean offset of the device, and memory of the radio map in bytes."""
        return {
            "particles_xy_m": self._map.xy_m,
            "particles_level": self._map.level,
            "particles_weight": self._belief.sum(axis=1),
            "offset_db": np.array(float(self._belief.sum(axis=0) @ self._offset_db)),
            "nbytes": np.array(self._map.nbytes),
        }

    def _anywhere(self) -> FloatArray:
        """(N, K) what is believed of a walker who may be anywhere."""
        belief: FloatArray = np.tile(self._prior, (len(self._map.xy_m), 1)) / len(self._map.xy_m)
        return belief

    def _spread(self, since_s: float) -> None:
        """Walks for so long, anywhere; a small part of the belief begins anew."""
        p, places = self._params, self._map
        sigma_m = p.speed_mps * since_s
        if sigma_m > p.field.lattice_m * places.row.max():  # across the whole survey
            self._belief = self._anywhere()
            return
        parts = np.split(self._belief, places.first[1:-1])
        spread = np.concatenate([places.smoothed(one, part, sigma_m, 3.0) for one, part in enumerate(parts)])
        spread = spread / spread.sum() if spread.sum() > 0 else self._anywhere()
        self._belief = (1.0 - p.lost_fraction) * spread + p.lost_fraction * self._anywhere()

    def _weigh(self, access_points: IntArray, rssi_dbm: list[float]) -> None:
        """Multiplies the belief by the likelihood of readings, the least one on levels where little is left."""
        places, p = self._map, self._params
        of_level = np.add.reduceat(self._belief.sum(axis=1), places.first[:-1])
        numbers = np.flatnonzero(of_level > p.min_level).tolist()
        found = p.log_likelihood(places, numbers, access_points, rssi_dbm, self._offset_db)
        is_asked = np.repeat(of_level > p.min_level, np.diff(places.first))
        log_likelihood = np.full(self._belief.shape, found.min())
        log_likelihood[is_asked] = found
        self._multiply(log_likelihood)

    def _multiply(self, log_likelihood: FloatArray) -> None:
        belief = self._belief * np.exp(log_likelihood - log_likelihood.max())
        self._belief = belief / belief.sum() if belief.sum() > 0 else self._anywhere()

    def _locate(self) -> None:
        """The estimate: on the level of most belief, the mean around the peak, and the spread about that."""
        places, belief = self._map, self._belief.sum(axis=1)
        of_level = np.add.reduceat(belief, places.first[:-1])
        best = int(np.argmax(of_level))
        here = slice(places.first[best], places.first[best + 1])
        weight, xy_m = belief[here] / of_level[best], places.xy_m[here]
        near = weight * self._nearness(weight, xy_m, places.row[here])
        mean_m = near @ xy_m / near.sum()
        variance_m2 = float(weight @ ((xy_m - mean_m) ** 2).sum(axis=1)) / 2 + self._params.field.lattice_m**2 / 12
        self._estimate = Estimate(mean_m, int(places.levels[best]), sigma_m=math.sqrt(variance_m2))

    def _nearness(self, weight: FloatArray, xy_m: FloatArray, row: IntArray) -> FloatArray:
        """(N,) how near places are to where there is most belief within `answer_m`, 1 there."""
        p = self._params
        if math.isinf(p.answer_m):
            return np.ones(len(weight))
        floor = np.zeros(row.max(axis=0) + 1)
        floor[*row.T] = weight
        sigma = p.answer_m / p.field.lattice_m
        peak_m = xy_m[np.argmax(gaussian_filter(floor, sigma, mode="constant", truncate=3.0)[*row.T])]
        nearness: FloatArray = np.exp(-0.5 * ((xy_m - peak_m) ** 2).sum(axis=1) / p.answer_m**2)
        return nearness
