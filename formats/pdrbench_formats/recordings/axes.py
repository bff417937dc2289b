"""Axes, signs and unit of a gyroscope, by directions that stay where they are while the device turns.

What the accelerometer and the magnetometer measure, turned by the integrated rates, points in one direction for some
seconds: gravity, since the accelerations of a walk cancel, and the field of the Earth, but for iron. Read with wrong
axes, the same rates spread it. The length that is lost by adding up is compared for the rates as they are, for each of
the 48 ways to exchange their axes and turn them round, and for rates in another unit.

Gravity shows a fault where the device tilts, the magnetic field where it turns about the vertical.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import multiply
from pdrbench.sensors.checks import MAX_ROWS, MIN_ROWS, Finding, lengths, windows

_BIN_S: Final = 0.04
_BLOCK: Final = 100  # bins, 4 s: a turn around a corner, while a bias of 1 degree/s turns by 4 degrees
_MAX_BLOCKS: Final = 150
_MIN_LOSS: Final = {"accel": 0.06, "mag": 0.12}  # summed over blocks; 50 real walks lose at most 0.011, 0.07 so
_MIN_RATIO: Final = {"accel": 2.0, "mag": 4.0}  # a shoe that swings: 1.8
_MAX_SHAKING: Final = 1.06  # mean length of specific force against gravity; phones in hands 1.04, feet 1.1 to 1.9
_FIELD_UT: Final = (20.0, 75.0)
_MOST: Final = 1e4  # s, rad/s, m/s^2, uT: what a damaged file holds must not overflow
_DEGREE: Final = np.pi / 180.0
_HUGE: Final = 1e12  # in any unit
_WINDOW_S: Final = 0.5  # a step, over which shaking cancels
_MIN_EXPLAINED: Final = 0.5  # of how gravity turns, by what is taken for rates without a name that says so
_DEGREES_BELOW: Final = 0.13  # of the factor between rates in rad/s, 1, and in degrees, 0.017: their geometric mean
_FACTORS: Final = (1.0, -1.0, _DEGREE, 1.0 / _DEGREE)  # by which rates are tried
_AS_GIVEN: Final = ((0, 1, 2), (1.0, 1.0, 1.0))

_UNITS: Final = (
    (_DEGREE, "it turns many times faster than gravity", "it looks like degree/s: state the unit, or convert to rad/s"),
    (
        1.0 / _DEGREE,
        "it turns many times slower than gravity or the magnetic field",
        "it was converted from degree/s twice: leave it in rad/s",
    ),
)

BLOCK_S: Final = 2.0  # holds a swing and a stance of every gait
MOVING_RADPS: Final = 1.5  # largest rate of a block that counts
SWING_RADPS: Final = 4.0  # a shoe swings at 6 to 10
STANCE_RADPS: Final = 0.5  # mean over `STANCE_S` while it stands
STANCE_S: Final = 0.1
IMPACT_MPS2: Final = 20.0  # of one sample in a hundred
MIN_BLOCKS: Final = 5
# Of moving blocks that hold a swing and a stance. The thresholds were chosen on ten recorded walks of shoes and 18 of
# phones. No recorded walk of a phone among 46 is taken for a shoe (MallPhone-v2, IpinPhone-v1); 23 of 26 walks of
# shoes are (FootWalks-v1, FootVicon-v1, FootLoops-v1, FootShort-v1).
MIN_FRACTION: Final = 0.7

_Way = tuple[tuple[int, ...], tuple[float, ...]]


def turning(rows: Mapping[str, FloatArray], rest_mps2: float) -> Iterator[Finding]:
    """Findings "gyro-unit" and "axes" of a gyroscope beside an accelerometer, which reads `rest_mps2` at rest."""
    gyro, counts = _bins(rows["gyro"])
    frames = _frames(gyro[: len(gyro) // _BLOCK * _BLOCK].reshape(-1, _BLOCK, 3))
    losses = {}
    for name in (name for name in ("accel", "mag") if name in rows):
        usual = float(np.median(lengths(rows[name][:MAX_ROWS, 1:])))
        if name != "mag" or _FIELD_UT[0] <= usual <= _FIELD_UT[1]:
            vectors, given = _bins(rows[name])
            if name == "accel" and given.any() and lengths(vectors[given > 0]).mean() > _MAX_SHAKING * rest_mps2:
                return  # what a foot measures in the air adds to its length, whatever its axes are
            losses[name] = _losses(frames, counts, vectors)
    gravity = losses["accel"]
    if not gravity:
        return
    for name, what in (("accel", "gravity"), ("mag", "the magnetic field")):
        of = losses.get(name) or {_AS_GIVEN: 0.0}
        least, way = min((loss, way) for way, loss in of.items() if isinstance(way, tuple))
        for factor, seen, remedy in _UNITS:
            right = of.get(factor, least)
            is_clear = of[_AS_GIVEN] > max(right + _MIN_LOSS[name], _MIN_RATIO[name] * right) and least > 2.0 * right
            # a magnetometer that reads its own iron does not turn, whatever the rates are: gravity must not contradict
            if is_clear and gravity[factor] <= gravity[_AS_GIVEN] + _MIN_LOSS["accel"]:
                yield Finding("error", "gyro-unit", "gyro", seen, remedy)
                return
        if of[_AS_GIVEN] - least < _MIN_LOSS[name] or of[_AS_GIVEN] < _MIN_RATIO[name] * least:
            continue
        axes = ", ".join(f"{'-' if sign < 0 else ''}{'xyz'[axis]}" for axis, sign in zip(*way, strict=True))
        seen = f"{what} turns as if its axes were {axes} ({of[_AS_GIVEN]:.2f} of its length is lost, so {least:.2f})"
        if name == "accel":
            handed = "the axes are left-handed, or the gyroscope has the other sign" if axes == "-x, -y, -z" else ""
            remedy = handed or "accelerometer and gyroscope have different axes: name the columns in the order x, y, z"
            yield Finding("error", "axes", "gyro", seen, remedy)
            return
        with_gravity = gravity[way] > _MIN_RATIO["accel"] * gravity[_AS_GIVEN] + _MIN_LOSS["accel"]
        remedy = "the walk would turn the wrong way: check signs and order of the axes of gyroscope and magnetometer"
        if with_gravity:
            remedy = "the magnetometer has other axes than the gyroscope: name its columns in the order x, y, z"
        yield Finding("warning", "axes", "mag" if with_gravity else "gyro", seen, remedy)


def _bins(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(K, 3) means over bins of time, 0 where one is empty, and (K,) rows in each."""
    rows = np.clip(rows[rows[:, 0] < _MAX_BLOCKS * _BLOCK * _BIN_S], -_MOST, _MOST)
    at = (rows[:, 0] / _BIN_S).astype(np.int64)
    counts = np.bincount(at).astype(np.float64)
    sums = np.stack([np.bincount(at, weights=column) for column in rows[:, 1:].T], axis=1)
    return sums / np.maximum(counts, 1.0)[:, None], counts


def _losses(frames: FloatArray, counts: FloatArray, vectors: FloatArray) -> dict[_Way | float, float]:
    """Fraction of length lost, summed over blocks, by way of reading the axes and by factor of the rates; {} of few.

    Args:
        frames: As from `_frames`.
        counts: (K,) samples of the gyroscope in each bin.
        vectors: (K, 3) of another sensor in each bin.
    """
    num = min(frames.shape[1], len(vectors) // _BLOCK)
    v = vectors[: num * _BLOCK].reshape(num, _BLOCK, 3)
    given = v.any(axis=2)
    whole = ((counts[: num * _BLOCK].reshape(num, _BLOCK) > 0).mean(axis=1) > 0.85) & (given.mean(axis=1) > 0.3)
    v = v[whole]
    if not len(v):
        return {}
    length = np.sqrt((v**2).sum(axis=2)).sum(axis=1)
    # (F, B, 3, 3, 3) by i, j, l: component i of each axis j of the device, in the frame at the start of the block,
    # times component l of the vector
    of_blocks = frames[:, :num][:, whole]
    sums = (of_blocks.reshape(*of_blocks.shape[:3], 9).swapaxes(2, 3) @ v).reshape(len(_FACTORS), len(v), 3, 3, 3)

    def loss(factor: int, axes: FloatArray) -> float:
        added = np.einsum("bijl,lj->bi", sums[factor], axes)
        return float((1.0 - np.sqrt((added**2).sum(axis=1)) / length).sum())

    found: dict[_Way | float, float] = {factor: loss(2 + k, np.eye(3)) for k, factor in enumerate(_FACTORS[2:])}
    for order, signs in itertools.product(itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3)):
        axes = np.zeros((3, 3))
        axes[range(3), order] = signs  # turned axes turn the attitude: Q becomes A Q A', and no length is lost by A
        handed = float(np.linalg.det(axes))
        found[order, signs] = loss(0 if handed > 0.0 else 1, handed * axes)
    return found


def _frames(omega: FloatArray) -> FloatArray:
    """(F, B, N, 3, 3) matrices at the middle of each bin for each of `_FACTORS`, from rates (B, N, 3) of blocks."""
    from scipy.spatial.transform import Rotation

    q = _attitudes(np.concatenate([factor * omega for factor in _FACTORS]))
    matrices = Rotation.from_quat(q.reshape(-1, 4), scalar_first=True).as_matrix() if q.size else np.zeros((0, 3, 3))
    frames: FloatArray = matrices.reshape(len(_FACTORS), *omega.shape, 3)
    return frames


def _attitudes(omega: FloatArray) -> FloatArray:
    """(B, N, 4) attitudes at the middle of each bin, from rates (B, N, 3) in rad/s, each block from 1, 0, 0, 0."""
    angle = np.sqrt((omega**2).sum(axis=2, keepdims=True)) * _BIN_S

    def part(fraction: float) -> FloatArray:
        half = angle * fraction / 2.0
        return np.concatenate([np.cos(half), omega * (_BIN_S * fraction / 2.0) * np.sinc(half / np.pi)], axis=2)

    whole, half = part(1.0), part(0.5)
    begin = np.zeros((*omega.shape[:2], 4))
    begin[:, 0, 0] = 1.0
    for place in range(1, omega.shape[1]):
        begin[:, place] = multiply(begin[:, place - 1], whole[:, place - 1])
    return multiply(begin, half)


def turns_by_revolutions(gyro: FloatArray, accel: FloatArray) -> bool:
    """Whether rates (T, 4), read as rad/s, are revolutions by what they do to gravity."""
    factor, _, explained = _turning_of_gravity(gyro, accel)
    return explained > _MIN_EXPLAINED and 0.8 < factor / (2.0 * np.pi) < 1.25


def turns_in_degrees(gyro: FloatArray, accel: FloatArray) -> bool:
    """Whether rates (T, 4), read as rad/s, are degrees by what they do to gravity, in whatever unit `accel` is."""
    factor, sigma, _ = _turning_of_gravity(gyro, accel)
    return 2.0 * sigma < factor < _DEGREES_BELOW - 3.0 * sigma


def turns_gravity(rates: FloatArray, accel: FloatArray) -> bool:
    """Whether vectors (T, 4) of any name are the rates at which gravity turns, in rad/s or degrees/s."""
    factor, _, explained = _turning_of_gravity(rates, accel)
    return explained > _MIN_EXPLAINED and any(0.5 < factor / unit < 2.0 for unit in (1.0, _DEGREE))


def _turning_of_gravity(gyro: FloatArray, accel: FloatArray) -> tuple[float, float, float]:
    """How gravity turns beside what rates (T, 4) say: the factor between them, its sigma, and the part explained.

    Over windows of half a second the direction of gravity, (K, 3), turns by w x g dt: the factor of least squares
    between that and what it does, 1 for rad/s and 0.017 for degrees, where the device tilts at all.
    """
    if min(len(gyro), len(accel)) < MIN_ROWS or any((np.diff(rows[:, 0]) < 0).any() for rows in (gyro, accel)):
        return 0.0, 0.0, 0.0
    begin_s = [min(gyro[0, 0], accel[0, 0]), 0.0, 0.0, 0.0]
    means = [windows(np.clip(rows - begin_s, -_HUGE, _HUGE), _WINDOW_S)[0] for rows in (accel, gyro)]
    num = min(map(len, means))
    means = [part[:num] for part in means]
    up = means[0] / np.maximum(np.linalg.norm(means[0], axis=1, keepdims=True), 1e-9)
    predicted = np.cross(up[:-1] + up[1:], means[1][:-1] + means[1][1:]) * (_WINDOW_S / 4.0)
    turned = np.diff(up, axis=0)
    whole = np.isfinite(predicted).all(axis=1) & np.isfinite(turned).all(axis=1)
    predicted, turned = predicted[whole].ravel(), turned[whole].ravel()
    power = float(predicted @ predicted)
    if len(predicted) < 9 or not power:
        return 0.0, 0.0, 0.0
    factor = float(predicted @ turned) / power
    sigma = float(np.std(turned - factor * predicted)) / power**0.5
    return factor, sigma, factor**2 * power / max(float(turned @ turned), 1e-9)


def moves_as_shoe(rows: Mapping[str, FloatArray]) -> bool:
    """True where a recording swings and stands still in turns, all along, as only a shoe does.

    Args:
        rows: (T, 4) of `accel` and `gyro` by name, as in a log; without one of them the answer is False.
    """
    if not {"accel", "gyro"} <= rows.keys() or min(len(rows["accel"]), len(rows["gyro"])) < 2:
        return False
    rate_radps, force_mps2 = (lengths(np.clip(rows[name][:, 1:4], -_MOST, _MOST)) for name in ("gyro", "accel"))
    t_s = rows["gyro"][:, 0]
    if np.quantile(force_mps2, 0.99) < IMPACT_MPS2:
        return False
    gap_s = float(np.median(np.diff(t_s)))
    width = max(1, round(STANCE_S / gap_s)) if gap_s > 0 else 1
    calm_radps = np.convolve(rate_radps, np.full(width, 1.0 / width), mode="same")
    first = np.flatnonzero(np.diff((t_s - t_s[0]) // BLOCK_S, prepend=-1.0))
    swing_radps, stance_radps = np.maximum.reduceat(rate_radps, first), np.minimum.reduceat(calm_radps, first)
    moving = swing_radps > MOVING_RADPS
    strides = (swing_radps > SWING_RADPS) & (stance_radps < STANCE_RADPS)
    return int(moving.sum()) >= MIN_BLOCKS and bool(strides.sum() >= MIN_FRACTION * moving.sum())
