"""When does the foot rest? Zero-velocity detectors as functions of the last samples of a foot-mounted unit.

Every detector answers with one number per sample: the standard deviation of "my velocity is zero", infinite where the
foot moves. A detector with a threshold knows one finite value; `soft` grades it. All windows end with the sample they
are about, so that nothing looks ahead and a stream in pieces gives the same bytes as the whole.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numba import njit

from pdrbench.geometry import FloatArray

Kind = Literal["shoe", "are", "mv", "mag", "interval", "soft"]
GRAVITY_MPS2: Final = 9.80665
MIN_ROWS: Final = 3


@dataclass(frozen=True, slots=True)
class Detector:
    """A detector and its settings.

    With a window of W samples, specific force a, rate w, gravity g, and the mean a_m over the window, the statistics
    of Skog, Handel, Nilsson and Rantakokko (IEEE TBME 57(11), 2010) are

    * `shoe` (stance hypothesis optimal): mean of |a - g a_m / |a_m||^2 / sigma_a^2 + |w|^2 / sigma_w^2;
    * `are` (angular rate energy): mean of |w|^2 / sigma_w^2;
    * `mv` (acceleration moving variance): mean of |a - a_m|^2 / sigma_a^2;
    * `mag` (acceleration magnitude): mean of (|a| - g)^2 / sigma_a^2;

    and the foot rests where one is below `threshold`. `interval` is the rest phase of Frank et al. 2009, section 3.2
    (F6): | |a| - g | has been within `threshold` m/s2 for `window_s`. `soft` is ours and has no threshold to set, see
    `soft_sigma`.

    Attributes:
        kind: Which one.
        threshold: Of the statistic; m/s2 for "interval"; the largest statistic at which `soft` says anything.
        window_s: Length of the window; at least `MIN_ROWS` samples.
        sigma_accel_mps2: Scale of the acceleration in the statistic.
        sigma_gyro_radps: Scale of the rate in the statistic.
        sigma_mps: Standard deviation of the zero velocity of a foot that rests.
        lever_m: `soft`: distance from the unit to the point the foot rolls about.
        knee_fraction: `soft`: trust has halved at a statistic, the knee, that is this fraction of the mean statistic of
            the last `knee_memory_s`, at least `lowest_knee`. A running foot, whose swings are violent, then rests at a
            statistic at which one that is lowered slowly is known to move. Fitted on recordings, see the laboratory's
            `foot_ins.left_out`.
        knee_memory_s: Time constant of that mean, about a stride.
        lowest_knee: See there; the statistic of a foot that stands still.
        still_threshold: SHOE statistic below which a foot may stand still; its rate is then measured as zero.
        still_s: For how long it has to be.
        sway_rad: Standard deviation of the angle by which a foot that stands turns between two moments, however far
            apart: the mean rate of a stand of T seconds is zero to sway_rad / T. In 190 stands of 60 recordings the
            foot turned about the vertical by 0.15 degrees.
    """

    kind: Kind
    threshold: float
    window_s: float = 0.025  # five samples at 200 Hz, as the open-source implementation of Skog et al.
    sigma_accel_mps2: float = 0.01
    sigma_gyro_radps: float = math.radians(0.1)
    sigma_mps: float = 0.01
    lever_m: float = 0.2
    knee_fraction: float = 0.024
    knee_memory_s: float = 1.0
    lowest_knee: float = 1e3
    still_threshold: float = 2e3
    still_s: float = 0.3
    sway_rad: float = math.radians(0.15)

    def __post_init__(self) -> None:
        positive = {name: getattr(self, name) for name in self.__slots__ if name not in ("kind", "still_threshold")}
        wrong = {name: value for name, value in positive.items() if not (value > 0 and math.isfinite(value))}
        if wrong:
            raise ValueError(f"zero-velocity detector: expected positive finite numbers; got {wrong}")


# `shoe`: as the open-source implementation of Skog et al. `are`, `mv`, `mag`: of the samples of the seven loops in
# `foot_loops`, during a walk, a third lies below: so long a foot rests (F6). No truth was looked at.
# `interval`: F6.
DETECTORS: Final[Mapping[str, Detector]] = MappingProxyType(
    {
        "shoe": Detector("shoe", 3e4),
        "are": Detector("are", 1.5e5),
        "mv": Detector("mv", 2.5e3),
        "mag": Detector("mag", 1.25e4),
        "interval": Detector("interval", 0.6, window_s=0.10),
        "soft": Detector("soft", 2e6),
    }
)


class Rest(NamedTuple):
    """What a detector says of n samples.

    Attributes:
        sigma_mps: (n,) standard deviation of a velocity of zero, inf where the foot moves.
        rate_sigma_radps: (n,) standard deviation of a rate of zero, inf where the foot moves or may roll.
        statistic: (n,) what the threshold was compared with.
    """

    sigma_mps: FloatArray
    rate_sigma_radps: FloatArray
    statistic: FloatArray

    @property
    def is_rest(self) -> Any:
        """(n,) bool."""
        return np.isfinite(self.sigma_mps)


class RestDetector:
    """Applies a `Detector` to a stream, piece by piece.

    Args:
        detector: Which one.
        rate_hz: Nominal rate of the samples.
    """

    def __init__(self, detector: Detector, rate_hz: float) -> None:
        self._detector = detector
        self._rows = window_rows(detector.window_s, rate_hz)
        # Neighbouring samples err alike: a faster sensor has more of them, each of which says less.
        self._scale = math.sqrt(rate_hz / 200.0) if detector.kind == "soft" else 1.0
        self._rate_hz = rate_hz
        self._tail = np.zeros((0, 3)), np.zeros((0, 3))
        self._since = np.full(2, np.inf)  # since when: within the interval, standing still
        self._recent = np.array([np.nan, 0.0])  # time of the last sample, mean of the statistic before it

    def update(self, t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> Rest:
        """What is to be said of the next n samples.

        Args:
            t_s: (n,) seconds, following on those of the last call.
            accel: (n, 3) specific force, m/s2.
            gyro: (n, 3) rate, rad/s.
        """
        d, known = self._detector, len(self._tail[0])
        t_s = np.array(t_s)  # for a read-only array, or a column of a table, the kernel would be compiled again
        a, w = np.concatenate([self._tail[0], accel]), np.concatenate([self._tail[1], gyro])
        low = max(len(a) - self._rows + 1, 0)
        self._tail = a[low:].copy(), w[low:].copy()
        scales = (d.sigma_accel_mps2, d.sigma_gyro_radps, GRAVITY_MPS2)
        shoe = statistic("shoe", a, w, self._rows, *scales)[known:]
        is_quiet = shoe < d.still_threshold
        still_s = held_s(t_s, is_quiet, self._since[1:])
        # information 2 T dt / sway^2 a sample adds up to T^2 / sway^2
        still_sigma = d.sway_rad * np.sqrt(self._rate_hz / (2 * np.maximum(still_s, d.still_s)))
        rate_sigma = np.where(is_quiet & (still_s >= d.still_s), still_sigma, np.inf)
        if d.kind == "interval":
            value = np.abs(np.linalg.norm(accel, axis=1) - GRAVITY_MPS2)
            is_within = value < d.threshold
            is_rest = is_within & (held_s(t_s, is_within, self._since[:1]) >= d.window_s)
            return Rest(np.where(is_rest, d.sigma_mps, np.inf), rate_sigma, value)
        if d.kind == "soft":
            recent = recent_mean(t_s, shoe, d.knee_memory_s, self._recent)
            knee = np.maximum(d.knee_fraction * recent, d.lowest_knee)
            sigma = self._scale * soft_sigma(shoe, np.sqrt(np.einsum("ij,ij->i", gyro, gyro)), d, knee)
            return Rest(sigma, rate_sigma, shoe)
        value = shoe if d.kind == "shoe" else statistic(d.kind, a, w, self._rows, *scales)[known:]
        return Rest(np.where(value < d.threshold, d.sigma_mps, np.inf), rate_sigma, value)


def detect(t_s: FloatArray, accel: FloatArray, gyro: FloatArray, detector: Detector) -> Rest:
    """What a detector says of a whole recording.

    Args:
        t_s: (n,) seconds, not decreasing.
        accel: (n, 3) specific force, m/s2.
        gyro: (n, 3) rate, rad/s.
        detector: Which one.
    """
    return RestDetector(detector, nominal_rate_hz(t_s)).update(t_s, accel, gyro)


def nominal_rate_hz(t_s: FloatArray) -> float:
    """One over the median time between samples that differ in time; 200 where there are none."""
    steps = np.diff(t_s)
    steps = steps[steps > 0]
    return float(1.0 / np.median(steps)) if len(steps) else 200.0


def window_rows(window_s: float, rate_hz: float) -> int:
    """Number of samples in a window, at least `MIN_ROWS`.

    >>> window_rows(0.025, 200.0), window_rows(0.025, 50.0)
    (5, 3)
    """
    return max(MIN_ROWS, round(window_s * rate_hz))


def soft_sigma(shoe: FloatArray, rate_radps: FloatArray, detector: Detector, knee: FloatArray) -> FloatArray:
    """How far from zero the velocity of the unit may be, in m/s.

    A foot in stance rolls over its sole: a unit at a distance r from the contact then moves at r times its rate.
    Against motion capture the ratio of speed and rate is 0.13 to 0.19 m from standing up to rates of 1 rad/s, and grows
    once the foot lifts. So

        sigma = sqrt(sigma_0^2 + (r w)^2) (1 + T / knee),

    with T the SHOE statistic. Nothing is decided by a threshold: a running foot, which never rests, still reports
    its slowest moment, and a walking foot's first roll is not taken for rest.

    Args:
        shoe: (n,) SHOE statistic.
        rate_radps: (n,) magnitude of the rate.
        detector: Settings; inf is returned above its threshold.
        knee: (n,) statistic at which trust has halved.
    """
    rolling = np.hypot(detector.sigma_mps, detector.lever_m * rate_radps) * (1.0 + shoe / knee)
    sigma: FloatArray = np.where(shoe < detector.threshold, rolling, np.inf)
    return sigma


def statistic(
    kind: str, accel: FloatArray, gyro: FloatArray, rows: int, sigma_accel: float, sigma_gyro: float, gravity: float
) -> FloatArray:
    """(n,) statistic of a detector over the last `rows` samples, over fewer at the beginning; see `Detector`."""
    if kind == "shoe":
        shoe: FloatArray = _shoe(accel, gyro, rows, sigma_accel, sigma_gyro, gravity)
        return shoe
    force2, rate2 = (accel**2).sum(axis=1), (gyro**2).sum(axis=1)
    if kind == "are":
        value = _trailing_mean(rate2, rows) / sigma_gyro**2
    elif kind == "mv":
        means = [_trailing_mean(np.ascontiguousarray(column), rows) for column in accel.T]
        value = (_trailing_mean(force2, rows) - np.square(means).sum(axis=0)) / sigma_accel**2
    elif kind == "mag":
        value = _trailing_mean((np.sqrt(force2) - gravity) ** 2, rows) / sigma_accel**2
    else:
        raise ValueError(f"no statistic of that name: {kind!r}")
    return np.asarray(value)


@njit(cache=True, error_model="numpy", nogil=True)
def _shoe(accel: Any, gyro: Any, rows: int, sigma_accel: float, sigma_gyro: float, gravity: float) -> Any:
    value = np.empty(len(accel))
    weight_a, weight_w = 1.0 / sigma_accel**2, 1.0 / sigma_gyro**2
    for k in range(len(accel)):
        low = max(k - rows + 1, 0)
        m0, m1, m2 = 0.0, 0.0, 0.0
        for i in range(low, k + 1):
            m0, m1, m2 = m0 + accel[i, 0], m1 + accel[i, 1], m2 + accel[i, 2]
        scale = gravity / math.sqrt(m0 * m0 + m1 * m1 + m2 * m2 + 1e-300)
        off, turn = 0.0, 0.0
        for i in range(low, k + 1):
            d0, d1, d2 = accel[i, 0] - scale * m0, accel[i, 1] - scale * m1, accel[i, 2] - scale * m2
            off += d0 * d0 + d1 * d1 + d2 * d2
            turn += gyro[i, 0] * gyro[i, 0] + gyro[i, 1] * gyro[i, 1] + gyro[i, 2] * gyro[i, 2]
        value[k] = (weight_a * off + weight_w * turn) / (k + 1 - low)
    return value


@njit(cache=True, error_model="numpy", nogil=True)
def _trailing_mean(values: Any, rows: int) -> Any:
    """(n,) mean over the last `rows` values, over fewer at the beginning."""
    mean = np.empty(len(values))
    for k in range(len(values)):
        low = max(k - rows + 1, 0)
        mean[k] = values[low : k + 1].sum() / (k + 1 - low)
    return mean


@njit(cache=True, error_model="numpy", nogil=True)
def held_s(t_s: Any, holds: Any, since_s: Any) -> Any:
    """(n,) for how long something has held without a break at each sample, 0 where it does not.

    Args:
        t_s: (n,) seconds.
        holds: (n,) bool.
        since_s: (1,) since when it has held, inf where it does not; carried from piece to piece, updated.
    """
    value = np.zeros(len(t_s))
    for k in range(len(t_s)):
        if not holds[k]:
            since_s[0] = np.inf
            continue
        since_s[0] = min(since_s[0], t_s[k])
        value[k] = t_s[k] - since_s[0]
    return value


@njit(cache=True, error_model="numpy", nogil=True)
def recent_mean(t_s: Any, values: Any, memory_s: float, state: Any) -> Any:
    """(n,) exponentially weighted mean over time of a signal up to each sample.

    Args:
        t_s: (n,) seconds.
        values: (n,) the signal.
        memory_s: Time constant.
        state: (2,) time of the sample before, NaN where there is none, and the mean there; updated.
    """
    mean = np.empty(len(values))
    for k in range(len(values)):
        if not math.isnan(state[0]):
            state[1] = values[k] + (state[1] - values[k]) * math.exp((state[0] - t_s[k]) / memory_s)
        else:
            state[1] = values[k]
        state[0] = t_s[k]
        mean[k] = state[1]
    return mean
