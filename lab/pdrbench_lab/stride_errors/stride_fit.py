"""The law that errors of strides are drawn with: fitted to recordings of the foot, and tested on each set left out.

`stride_errors` measures statistics. Statistics over walks contain what the estimator adds for want of strides; here
that is taken out: an observed drift is a drift of Student's law plus a normal error of known size, and the law is
fitted to what was observed by maximum likelihood. lab/notebook/error-model.md has the model and its figures.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench import __version__
from pdrbench.datasets import find
from pdrbench.datasets.folders import data_folders
from pdrbench.errors import DatasetError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import LITERAL, StrideParams, find_strides, navigate
from pdrbench.io.log import Log
from pdrbench.metrics.inertial import median_slope
from pdrbench_lab.readers import foot_dual, foot_loops, foot_short
from pdrbench_lab.stride_errors.error_file import FORMAT, ErrorFile, ErrorSizes, ErrorSource, ErrorStatistic
from pdrbench_lab.stride_errors.stride_errors import (
    OUTLIER_SIGMAS,
    Ends,
    WalkErrors,
    at_places,
    at_rests,
    components,
    heading_differences_deg,
    robust_sigma,
    settings_of,
    stride_errors,
    why_not,
)
from pdrbench_sim.readers import foot_stride_gcp, foot_vicon
from pdrbench_sim.units.strides import STRIDE_LAW

FITTED: Final = STRIDE_LAW  # environments draw with it
MIN_LAG: Final = 4  # strides; errors of headings nearer than that have something in common, which is no random walk
SHUFFLES: Final = 200  # of the residuals of a walk, for the error of its drift
MAX_RESIDUAL_DEG: Final = 10.0  # a walk whose headings scatter by more is one on which the filter diverged
# Of what follows no law, as where the reference jumped: even over +-0.5 m, +-0.5 m and +-45 degrees.
STRAY_DENSITY: Final = np.array([1.0, 1.0, 1 / 90.0])
EM_STEPS: Final = 200
_SEED: Final = 20081123
UNREGISTERED: Final = ("foot_dual", "foot_stride_gcp_2", "foot_vicon_2")


@dataclass(frozen=True, slots=True)
class FootSet:
    """Recordings of the foot with one kind of reference."""

    pattern: str  # files that are walks
    read: Callable[[Path], Log]
    ends: Ends | None  # None: only that the walk ends where it began is known


SETS: Final[Mapping[str, FootSet]] = MappingProxyType(
    {
        "foot_vicon": FootSet("**/*.mat", foot_vicon.read, at_rests),
        "foot_vicon_2": FootSet("**/*.mat", foot_vicon.read, at_rests),
        "foot_stride_gcp": FootSet("**/*_LLIO.mat", foot_stride_gcp.read, at_places),
        "foot_stride_gcp_2": FootSet("**/*_LLIO.mat", foot_stride_gcp.read, at_places),
        "foot_loops": FootSet("**/data_inert.txt", foot_loops.read, None),
        "foot_short": FootSet("*.csv", foot_short.read, None),
    }
)


# Not in the law: what a localizer may assume of strides that are drawn from it.
PRIOR_SET: Final = "foot_dual"
PRIOR: Final = FootSet("**/imuMeas*.csv", foot_dual.read, at_rests)


@dataclass(frozen=True, slots=True)
class FootWalk:
    """What one walk says of the errors of strides."""

    set: str  # name of its set
    drift_deg: float  # a stride, as estimated
    weight: (
        FloatArray  # (S,) what the heading error of each stride adds to that estimate where it is linear; else empty
    )
    errors: WalkErrors | None  # of a walk with a reference of its strides
    num_strides: int

    @property
    def offset_m(self) -> float:
        """Median over the strides of the error of length; NaN where lengths are not known."""
        return math.nan if self.errors is None else float(np.median(self.errors.length_error_m))

    def residuals(self) -> FloatArray:
        """(S, 3) errors: length about the walk's median in m, height in m, heading about its line in degrees."""
        if self.errors is None:
            return np.zeros((0, 3))
        about_m = self.errors.length_error_m - self.offset_m
        return np.column_stack([about_m, self.errors.rise_error_m, np.degrees(self.errors.residual_rad)])


@dataclass(frozen=True, slots=True)
class StrideLaw:
    """The fitted law, in metres and degrees; fields as `StrideErrors` has them."""

    offset_m: float
    offset_sigma_m: float
    sigma: FloatArray  # (3,) of length, height (m) and heading (degrees) of a stride that is not coarse
    coarse_fraction: float
    coarse_factor: float
    stray_fraction: float  # of strides that follow no law: not drawn
    turn_sigma_deg: float
    drift_scale_deg: float
    drift_freedom: float

    def sizes(self) -> ErrorSizes:
        """As strides are drawn."""
        written = {
            "length_bias": 0.0,
            "length_sigma_m": self.sigma[0],
            "height_sigma_m": self.sigma[1],
            "drift_mean_rad": 0.0,
            "drift_sigma_rad": math.radians(self.drift_scale_deg),
            "turn_sigma_rad": math.radians(self.turn_sigma_deg),
            "heading_sigma_rad": math.radians(self.sigma[2]),
            "length_offset_m": self.offset_m,
            "length_offset_sigma_m": self.offset_sigma_m,
            "drift_tail": 1 / self.drift_freedom,
            "coarse_fraction": self.coarse_fraction,
            "coarse_factor": self.coarse_factor,
        }
        return ErrorSizes(**{name: float(f"{value:.4g}") for name, value in written.items()})


@dataclass(frozen=True, slots=True)
class LeftOut:
    """How a law that was fitted without a set fares on it."""

    set: str
    num_walks: int
    num_strides: int  # with a reference
    inside_50: (
        float  # fraction of walks whose drift lies in the middle half of what the law expects for so many strides
    )
    inside_90: float
    drift_gain: float  # mean log density of a drift over that of a normal law with raw mean and deviation
    offset_error_m: float  # mean offset of the set less the law's; NaN without lengths
    outliers: float  # fraction of strides of which length or heading is off by four robust sigmas of the other sets
    outliers_expected: float  # of strides drawn from the law
    stride_gain: float  # mean log density of a stride over that of normal laws with the robust sigmas


def foot_walks(names: Sequence[str] = tuple(SETS)) -> tuple[list[FootWalk], list[ErrorSource]]:
    """What every usable walk of some sets says, and what the sets are.

    Raises:
        DatasetError: A set is not available.
    """
    walks: list[FootWalk] = []
    sources = []
    for name in names:
        kind, folder = PRIOR if name == PRIOR_SET else SETS[name], _folder(name)
        paths = sorted(path for path in folder.glob(kind.pattern) if path.is_file())
        left_out: dict[str, str] = {}
        found = []
        for path in paths:
            walk_name = path.relative_to(folder).as_posix()
            try:
                found.append(_foot_walk(name, kind, path))
            except RecordingError as error:
                left_out[walk_name] = str(error).replace(str(path), path.name)
        digest = hashlib.sha256(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in paths)).hexdigest()
        sources.append(ErrorSource("", name, digest, len(found), left_out))
        walks += found
    return walks, sources


def _folder(name: str) -> Path:
    """Of a set, which need not be registered."""
    for place in data_folders():
        if (place / name).is_dir():
            return place / name
    if name in UNREGISTERED:
        raise DatasetError(f"no folder {name} in PDRBENCH_DATA; lab/notebook/error-model.md says what it holds")
    return find(name)


def _foot_walk(name: str, kind: FootSet, path: Path) -> FootWalk:
    log = kind.read(path)
    accel, gyro = log.rows["accel"], log.rows["gyro"]
    states = navigate(accel[:, 0], accel[:, 1:], gyro[:, 1:], LITERAL)
    if kind.ends is None:
        strides = find_strides(states, StrideParams(settle_s=0.0, same_stance_s=0.0))
        return closed_walk(name, (strides.end_xyz_m - strides.start_xyz_m)[:, :2])
    return surveyed_walk(name, stride_errors(log.reference, states, *kind.ends(log.reference, states)))


def surveyed_walk(name: str, errors: WalkErrors) -> FootWalk:
    """A walk with a reference at its strides.

    Raises:
        RecordingError: It says nothing of walking strides.
    """
    why = why_not(errors)
    if not why and (scatter := math.degrees(robust_sigma(errors.residual_rad))) > MAX_RESIDUAL_DEG:
        why = f"the filter diverged: headings scatter by {scatter:.0f} degrees"
    if why:
        raise RecordingError(why)
    return FootWalk(name, math.degrees(errors.drift_rad), np.zeros(0), errors, len(errors))


def closed_walk(name: str, step_m: FloatArray) -> FootWalk:
    """A walk that ends where it began: the drift that closes it best.

    A drift d turns stride k by k d, which moves the end by d G with G = sum k J step_k; d = gap . G / |G|^2 takes it
    back, to first order. The heading error of stride k adds (J step_k) . G / |G|^2 times its size to d.

    Args:
        name: Of its set.
        step_m: (S, 2) strides as navigated.
    """
    across_m = np.column_stack([-step_m[:, 1], step_m[:, 0]])
    moved_m = np.arange(len(step_m)) @ across_m
    weight = across_m @ moved_m / (moved_m @ moved_m)
    drift_deg = math.degrees(float(step_m.sum(axis=0) @ moved_m / (moved_m @ moved_m)))
    return FootWalk(name, drift_deg, weight, None, len(step_m))


def fit(walks: Sequence[FootWalk]) -> StrideLaw:
    """The law that suits the walks best."""
    from scipy.optimize import minimize

    surveyed = [walk for walk in walks if walk.errors is not None]
    weights, sigma, factor = _fit_strides(np.concatenate([walk.residuals() for walk in surveyed]))
    white_deg, turn_deg = _heading_parts(surveyed)
    drift_deg, error_deg = np.array([walk.drift_deg for walk in walks]), drift_errors_deg(walks, white_deg, turn_deg)

    def misfit(x: FloatArray) -> float:
        return -float(drift_log_density(drift_deg, error_deg, math.exp(x[0]), 1 + math.exp(x[1])).sum())

    start, bounds = [math.log(0.1), math.log(3.0)], [(-7.0, 2.0), (-2.0, 4.0)]
    found = minimize(misfit, start, method="Nelder-Mead", bounds=bounds)
    offset_m = np.array([walk.offset_m for walk in surveyed])
    own = np.array([1.57 * robust_sigma(walk.residuals()[:, 0]) ** 2 / walk.num_strides for walk in surveyed])  # median
    return StrideLaw(
        offset_m=float(offset_m.mean()),
        offset_sigma_m=math.sqrt(max(float(np.var(offset_m, ddof=1) - own.mean()), 0.0)),
        sigma=sigma,
        coarse_fraction=float(weights[1] / weights[:2].sum()),
        coarse_factor=factor,
        stray_fraction=float(weights[2]),
        turn_sigma_deg=turn_deg,
        drift_scale_deg=math.exp(found.x[0]),
        drift_freedom=1 + math.exp(found.x[1]),
    )


def _fit_strides(residuals: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Two normal laws with one factor between them, and stray: their weights (3,), the smaller sigmas (3,), the factor.

    Expectation and maximisation; a stride is coarse in all that is known of it or in nothing.
    """
    known = np.isfinite(residuals)
    squared = np.where(known, residuals, 0.0) ** 2
    sigma, factor, weights = np.array([0.015, 0.015, 0.8]), 4.0, np.array([0.9, 0.09, 0.01])
    stray = np.where(known, np.log(STRAY_DENSITY), 0.0).sum(axis=1)
    for _ in range(EM_STEPS):
        density = np.column_stack([_log_normal(squared, known, s * sigma) for s in (1.0, factor)] + [stray])
        part = np.exp(density + np.log(weights) - (density + np.log(weights)).max(axis=1, keepdims=True))
        part /= part.sum(axis=1, keepdims=True)
        weights = part.mean(axis=0) + 1e-12
        fine, coarse = part[:, :1] * known, part[:, 1:2] * known
        sigma = np.sqrt(((fine + coarse / factor**2) * squared).sum(axis=0) / (fine + coarse).sum(axis=0).clip(1e-9))
        sigma = sigma.clip(1e-4)
        factor = max(1.0, math.sqrt(float((coarse * squared / sigma**2).sum() / max(coarse.sum(), 1e-9))))
    return weights, sigma, factor


def _log_normal(squared: FloatArray, known: FloatArray, sigma: FloatArray) -> FloatArray:
    """(S,) log density of what is known of each stride."""
    density: FloatArray = -0.5 * squared / sigma**2 - np.log(sigma) - 0.5 * math.log(2 * math.pi)
    return np.asarray(np.where(known, density, 0.0).sum(axis=1))


def _heading_parts(walks: Sequence[FootWalk]) -> tuple[float, float]:
    """`components` of headings at least `MIN_LAG` strides apart, in degrees."""
    pairs = np.concatenate([heading_differences_deg(walk.errors) for walk in walks if walk.errors is not None])
    return components(pairs[pairs[:, 0] >= MIN_LAG])


def drift_errors_deg(walks: Sequence[FootWalk], white_deg: float, turn_deg: float) -> FloatArray:
    """(W,) standard deviation of what each estimated drift is off.

    Of the median slope: what shuffled residuals of the walk show, and the slope of a random walk, 6/5 sigma^2 / n. Of
    a closed walk: of the linear estimate.
    """
    rng = np.random.default_rng(_SEED)
    errors = []
    for walk in walks:
        if walk.errors is None:
            later = np.cumsum(walk.weight[::-1])[::-1]
            errors.append(math.hypot(white_deg * np.linalg.norm(walk.weight), turn_deg * np.linalg.norm(later)))
            continue
        number, residual_deg = walk.errors.number.astype(np.float64), walk.residuals()[:, 2]
        slopes = [median_slope(number, rng.permutation(residual_deg)) for _ in range(SHUFFLES)]
        errors.append(math.hypot(float(np.std(slopes)), turn_deg * math.sqrt(1.2 / walk.num_strides)))
    return np.array(errors)


def _nodes(error_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Errors (W, 41) of Gauss-Hermite quadrature and their weights."""
    node, weight = np.polynomial.hermite_e.hermegauss(41)
    return error_deg[:, None] * node, weight / weight.sum()


def drift_log_density(drift_deg: FloatArray, error_deg: FloatArray, scale_deg: float, freedom: float) -> FloatArray:
    """(W,) of observed drifts: Student's law about 0, plus a normal error of each walk."""
    from scipy.stats import t

    error, weight = _nodes(error_deg)
    density: FloatArray = t.pdf((drift_deg[:, None] - error) / scale_deg, freedom) @ weight / scale_deg
    logs: FloatArray = np.log(density)
    return logs


def drift_quantile(drift_deg: FloatArray, error_deg: FloatArray, law: StrideLaw) -> FloatArray:
    """(W,) probability of a smaller drift than the one observed."""
    from scipy.stats import t

    error, weight = _nodes(error_deg)
    return np.asarray(t.cdf((drift_deg[:, None] - error) / law.drift_scale_deg, law.drift_freedom) @ weight)


def left_out(walks: Sequence[FootWalk]) -> list[LeftOut]:
    """Each set in turn: the law of the others on it."""
    return [_left_out(name, walks) for name in dict.fromkeys(walk.set for walk in walks)]


def _left_out(name: str, walks: Sequence[FootWalk]) -> LeftOut:
    from scipy.stats import norm

    others, own = [walk for walk in walks if walk.set != name], [walk for walk in walks if walk.set == name]
    law, surveyed = fit(others), [walk for walk in others if walk.errors is not None]
    drift_deg = np.array([walk.drift_deg for walk in own])
    error_deg = drift_errors_deg(own, *_heading_parts(surveyed))
    off_middle = np.abs(drift_quantile(drift_deg, error_deg, law) - 0.5)
    raw = np.array([walk.drift_deg for walk in others])
    former = norm.logpdf(drift_deg, raw.mean(), raw.std(ddof=1))
    residuals = np.concatenate([walk.residuals() for walk in own])
    known = np.isfinite(residuals)
    trained = np.concatenate([walk.residuals() for walk in surveyed])
    robust = np.array([robust_sigma(column[np.isfinite(column)]) for column in trained.T])
    drawn = np.abs(np.random.default_rng(_SEED).standard_normal((20_000, 3))) * law.sigma
    drawn[: int(20_000 * law.coarse_fraction)] *= law.coarse_factor

    def far(rows: FloatArray) -> float:
        return float((np.abs(rows[:, [0, 2]]) >= OUTLIER_SIGMAS * robust[[0, 2]]).any(axis=1).mean())

    squared = np.where(known, residuals, 0.0) ** 2
    log_stray = math.log(law.stray_fraction) + np.where(known, np.log(STRAY_DENSITY), 0.0).sum(axis=1)
    fractions = (1 - law.stray_fraction) * np.array([1 - law.coarse_fraction, law.coarse_fraction])
    fine, coarse = (_log_normal(squared, known, scale * law.sigma) for scale in (1.0, law.coarse_factor))
    log_law = np.logaddexp.reduce([math.log(fractions[0]) + fine, math.log(fractions[1]) + coarse, log_stray])
    log_former = np.logaddexp(math.log(1 - law.stray_fraction) + _log_normal(squared, known, robust), log_stray)
    drift_density = drift_log_density(drift_deg, error_deg, law.drift_scale_deg, law.drift_freedom)
    return LeftOut(
        set=name,
        num_walks=len(own),
        num_strides=len(residuals),
        inside_50=float((off_middle < 0.25).mean()),
        inside_90=float((off_middle < 0.45).mean()),
        drift_gain=float(np.mean(drift_density - former)),
        offset_error_m=float(np.mean([walk.offset_m for walk in own])) - law.offset_m,
        outliers=far(residuals) if len(residuals) else math.nan,
        outliers_expected=far(drawn),
        stride_gain=float(np.mean(log_law - log_former)) if len(residuals) else math.nan,
    )


def measure_law() -> ErrorFile:
    """The law of all sets, the figures of each set left out, and those of the prior's set, as a file.

    Raises:
        DatasetError: A set is not available.
    """
    walks, sources = foot_walks()
    law = fit(walks)
    rows = [("stray_fraction", "share", law.stray_fraction, walks), ("drift_freedom", "1", law.drift_freedom, walks)]
    prior, prior_sources = foot_walks([PRIOR_SET])
    rows += [
        (f"{PRIOR_SET}: drift_deg_rms", "deg/stride", math.sqrt(np.mean([walk.drift_deg**2 for walk in prior])), prior),
        (
            f"{PRIOR_SET}: length_bias",
            "1",
            float(np.mean([walk.errors.length_bias for walk in prior if walk.errors is not None])),
            prior,
        ),
    ]
    for found in left_out(walks):
        own = [walk for walk in walks if walk.set == found.set]
        rows += [(f"{found.set}: {name}", unit, getattr(found, name), own) for name, unit in LEFT_OUT_UNITS.items()]
    return ErrorFile(
        format=FORMAT,
        pdrbench=__version__,
        filter="literal",
        settings=settings_of(LITERAL),
        sources=sources + prior_sources,
        errors=law.sizes(),
        statistics=[_row(*row) for row in rows],
    )


LEFT_OUT_UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "inside_50": "share",
        "inside_90": "share",
        "drift_gain": "nat/walk",
        "offset_error_m": "m",
        "outliers": "share",
        "outliers_expected": "share",
        "stride_gain": "nat/stride",
    }
)


def _row(name: str, unit: str, value: float, walks: Sequence[FootWalk]) -> ErrorStatistic:
    strides = sum(walk.num_strides for walk in walks)
    written = float(f"{value:.4g}") if math.isfinite(value) else None
    return ErrorStatistic(name, unit, written, None, None, len(walks), strides, "")
