"""Changes of windows in training, as of other directions and devices: `Change` of `pdrbench.learning.windows`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pdrbench.learning.windows import About, Change, Floats


def any_yaw(inputs: Floats, targets: Floats, rng: np.random.Generator, about: About) -> tuple[Floats, Floats]:
    """Level windows and their targets, turned about the vertical by any angle."""
    angle = rng.uniform(-np.pi, np.pi, len(inputs))
    c, s, o = np.cos(angle), np.sin(angle), np.zeros(len(angle))
    turn = np.array([[c, -s, o], [s, c, o], [o, o, o + 1]], np.float32).transpose(2, 0, 1)
    return _turned(inputs, turn, about), np.einsum("bij,bj->bi", turn[:, :2, :2], targets)


def other_mounting(sigma_rad: float) -> Change:
    """As of a device that is mounted askew, by so much about each axis; targets stay."""

    def change(inputs: Floats, targets: Floats, rng: np.random.Generator, about: About) -> tuple[Floats, Floats]:
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_rotvec(rng.normal(0.0, sigma_rad, (len(inputs), 3))).as_matrix()
        return _turned(inputs, turn.astype(np.float32), about), targets

    return change


def lower_rate(min_hz: float) -> Change:
    """As of a device of `min_hz` or more, one for each batch: straight lines between fewer samples."""

    def change(inputs: Floats, targets: Floats, rng: np.random.Generator, about: About) -> tuple[Floats, Floats]:
        last = inputs.shape[2] - 1
        few = max(round(last * rng.uniform(min_hz / about.rate_hz, 1.0)), 1)
        kept = np.linspace(0, last, few + 1).round().astype(np.int64)
        place = np.interp(np.arange(last + 1), kept, np.arange(few + 1))
        before = place.astype(np.int64).clip(max=few - 1)
        part = (place - before).astype(np.float32)
        return inputs[:, :, kept[before]] * (1 - part) + inputs[:, :, kept[before + 1]] * part, targets

    return change


def noise(by_device: Mapping[str, Mapping[str, tuple[float, float]]]) -> Change:
    """White noise, and one constant error of a window: standard deviations by device ("" for others) and sensor."""

    def change(inputs: Floats, targets: Floats, rng: np.random.Generator, about: About) -> tuple[Floats, Floats]:
        sigmas = [by_device.get(device, by_device.get("", {})) for device in about.device]
        inputs = inputs.copy()
        for sensor, (first, end) in about.channels.items():
            white, constant = np.array([of.get(sensor, (0.0, 0.0)) for of in sigmas], np.float32).T[:, :, None, None]
            for sigma, length in ((white, inputs.shape[2]), (constant, 1)):
                inputs[:, first:end] += sigma * rng.standard_normal((len(inputs), end - first, length), np.float32)
        return inputs, targets

    return change


def _turned(inputs: Floats, turn: Floats, about: About) -> Floats:
    """Every vector among the channels, by (B, 3, 3)."""
    inputs = inputs.copy()
    for first, end in about.channels.values():
        if end - first == 3:
            inputs[:, first:end] = turn @ inputs[:, first:end]
    return inputs
