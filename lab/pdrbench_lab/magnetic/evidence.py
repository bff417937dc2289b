"""What a magnetometer says of particles, of which each knows more and more about the offset of the phone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building.convex import ConvexMap
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import MagneticMap
from pdrbench_lab.magnetic.field import MagneticField, MagneticFieldParams, magnitudes_of
from pdrbench_lab.magnetic.level_field import level_field_ut

KEPT_S: Final = 3.0  # of samples, for seconds that are reported late
MIN_SAMPLES: Final = 5
START_M: Final = 2.0  # side of the squares that particles begin in where the start is not known
SENSORS: Final = ("mag", "rotation")


@dataclass(frozen=True, slots=True)
class MagneticEvidenceParams:
    """Ours; see lab/notebook/magnetic.md for what was compared.

    Attributes:
        field: Of the map.
        window_s: Over which samples are averaged, up to the time of the particles.
        apart_m: A walker goes so far from one sample that counts to the next.
        horizontal_trust, vertical_trust: Powers of the likelihoods of both parts; 0 leaves one out. Samples of a few
            metres err alike.
        tail: Degrees of freedom of Student's t, in place of a normal density.
    """

    field: MagneticFieldParams = field(default_factory=MagneticFieldParams)
    window_s: float = 0.5
    apart_m: float = 1.0
    horizontal_trust: float = 0.0
    vertical_trust: float = 0.5
    tail: float = 4.0


@dataclass(slots=True)
class OffsetBelief:
    """What each of N particles believes of the offset of the phone: normal, horizontal and vertical independent.

    Attributes:
        horizontal_ut: (N, 2) means, to the right and ahead.
        covariance_ut2: (N, 2, 2) of these.
        vertical_ut: (N,) mean.
        variance_ut2: (N,) of it.
    """

    horizontal_ut: FloatArray
    covariance_ut2: FloatArray
    vertical_ut: FloatArray
    variance_ut2: FloatArray

    @classmethod
    def prior(cls, count: int, offset_ut: float) -> OffsetBelief:
        """Nothing measured yet."""
        covariance = np.tile(offset_ut**2 * np.eye(2), (count, 1, 1))
        return cls(np.zeros((count, 2)), covariance, np.zeros(count), np.full(count, offset_ut**2))

    def copy_to(self, which: IntArray, source: OffsetBelief, chosen: IntArray) -> None:
        """Particles `which` (n,) take the belief of particles `chosen` (n,) of another belief, or of this one."""
        for name in ("horizontal_ut", "covariance_ut2", "vertical_ut", "variance_ut2"):
            getattr(self, name)[which] = getattr(source, name)[chosen]

    def observe_horizontal(
        self, left_ut: FloatArray, noise_ut2: FloatArray, toward: FloatArray, tail: float
    ) -> FloatArray:
        """Kalman update by left_ut = toward . offset + noise, of Student's t.

        A sample counts with the weight (tail + 1) / (tail + z^2) of its standardised innovation z.

        Args:
            left_ut: (N,) measured less what the map has there.
            noise_ut2: (N,) variance.
            toward: (2,) direction of the measured field.
            tail: Degrees of freedom.

        Returns:
            (N,) log-density of the innovation, up to a constant.
        """
        gain = self.covariance_ut2 @ toward
        innovation, known = left_ut - self.horizontal_ut @ toward, gain @ toward
        log_density, noise_ut2 = _student(innovation, known, noise_ut2, tail)
        variance = known + noise_ut2
        self.horizontal_ut = self.horizontal_ut + gain * (innovation / variance)[:, None]
        self.covariance_ut2 = self.covariance_ut2 - gain[:, :, None] * gain[:, None, :] / variance[:, None, None]
        return log_density

    def observe_vertical(self, left_ut: FloatArray, noise_ut2: FloatArray, tail: float) -> FloatArray:
        """The same of the vertical part."""
        innovation = left_ut - self.vertical_ut
        log_density, noise_ut2 = _student(innovation, self.variance_ut2, noise_ut2, tail)
        gain = self.variance_ut2 / (self.variance_ut2 + noise_ut2)
        self.vertical_ut = self.vertical_ut + gain * innovation
        self.variance_ut2 = self.variance_ut2 * (1.0 - gain)
        return log_density


def _student(
    innovation: FloatArray, known_ut2: FloatArray, noise_ut2: FloatArray, tail: float
) -> tuple[FloatArray, FloatArray]:
    """(N,) log-densities of innovations of a variance, up to a constant, and the noise that their update takes."""
    variance = known_ut2 + noise_ut2
    square = innovation**2 / variance
    log_density: FloatArray = -0.5 * ((tail + 1.0) * np.log1p(square / tail) + np.log(variance))
    return log_density, noise_ut2 * (tail + square) / (tail + 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class FieldSample:
    """What was measured at one time, as an evaluator of likelihoods.

    Attributes:
        value_ut: (2,) horizontal magnitude and vertical part.
        toward: (2,) direction of the horizontal field in the level frame of the phone.
        evidence: The survey, and how far a sample is believed.
    """

    value_ut: FloatArray
    toward: FloatArray
    evidence: MagneticEvidence

    def log_likelihood(self, xy_m: FloatArray, level: IntArray, belief: OffsetBelief) -> FloatArray:
        """(N,) of particles at places (N, 2) on levels (N,); their belief takes the sample in.

        Student's t to the power of a trust, of which the belief takes the noise for 1 / trust times as much.
        """
        p = self.evidence.params
        mean_ut, variance_ut2 = self.evidence.field.at(xy_m, level)
        left_ut, noise_ut2 = self.value_ut - mean_ut, variance_ut2 + p.field.nugget_ut**2
        total = np.zeros(len(xy_m))
        if (trust := p.horizontal_trust) > 0.0:
            noise = noise_ut2[:, 0] / trust
            total += trust * belief.observe_horizontal(left_ut[:, 0], noise, self.toward, p.tail)
        if (trust := p.vertical_trust) > 0.0:
            total += trust * belief.observe_vertical(left_ut[:, 1], noise_ut2[:, 1] / trust, p.tail)
        return total


class MagneticEvidence:
    """A magnetic survey, and the samples of a walk.

    Args:
        magnetic_map: With one sample or more.
        params: See `MagneticEvidenceParams`.
    """

    def __init__(self, magnetic_map: MagneticMap, params: MagneticEvidenceParams) -> None:
        self.magnetic_map, self.params = magnetic_map, params
        self.field = MagneticField(magnetic_map, params.field)
        self._starts: dict[tuple[int, bytes], tuple[FloatArray, NDArray[np.int32]]] = {}
        self.begin()

    def begin(self) -> None:
        """Begins another walk."""
        self._rotation: FloatArray = np.zeros((0, 5))
        self._level: FloatArray = np.zeros((0, 4))
        self._gone_m = self.params.apart_m

    def update(self, rows: Mapping[str, FloatArray]) -> None:
        """Takes the next rows of `SENSORS`."""
        mag, rotation = (rows[name][np.isfinite(rows[name]).all(axis=1)] for name in SENSORS)
        self._rotation = np.concatenate([self._rotation[-1:], rotation])
        if len(mag) and len(self._rotation):
            latest = np.maximum(np.searchsorted(self._rotation[:, 0], mag[:, 0], side="right") - 1, 0)
            level_ut = level_field_ut(self._rotation[latest, 1:], mag[:, 1:])
            self._level = np.concatenate([self._level, np.column_stack([mag[:, 0], level_ut])])
            self._level = self._level[self._level[:, 0] > self._level[-1, 0] - KEPT_S]

    def starts_on(self, level: int, convex: ConvexMap) -> tuple[FloatArray, NDArray[np.int32]]:
        """Places (n, 2) evenly over what was surveyed of a level, and their cells (n,) of a map.

        One for each square with a sample: a corridor that was walked often is no likelier than others.
        """
        key = level, convex.corner_xy_m.tobytes()
        if key not in self._starts:
            squares = np.unique(np.floor(self.field.level(level).samples_m / START_M), axis=0)
            places_m, cells = convex.nearest((squares + 0.5) * START_M, level)
            self._starts[key] = places_m, cells.astype(np.int32)
        return self._starts[key]

    def after(self, gone_m: float, end_s: float) -> FieldSample | None:
        """The sample of a time until which the walker went so far since the last call; None where none counts."""
        self._gone_m += gone_m
        if self._gone_m < self.params.apart_m:
            return None
        t_s = self._level[:, 0]
        within = (t_s > end_s - self.params.window_s) & (t_s <= end_s)
        if within.sum() < MIN_SAMPLES:
            return None
        self._gone_m = 0.0
        value_ut, toward = magnitudes_of(self._level[within, 1:])
        return FieldSample(value_ut.mean(axis=0), toward.mean(axis=0), self)
