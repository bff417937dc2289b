"""The network in compiled code: a window in a fraction of a millisecond, without PyTorch.

A library for networks of any size takes 180 MB, and most of its time to call operations that take less: this one
multiplies a million times a window. Values are float64, and sums have one order on every processor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.compiled import compiled
from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.constants import CNN, INPUTS, LAYERS, LOG_SIGMA, SCALES, USUAL_HEIGHT_M
from pdrbench_baselines.learned.kernels import yaw_means
from pdrbench_baselines.learned.reckoning import WindowAnswer
from pdrbench_baselines.learned.signals import CHANNELS, WINDOW, grid_signals
from pdrbench_baselines.learned.weight_files import PACKAGED, PACKAGED_SHA256, TRAIN, check_form, read_arrays

_NORM_EPSILON: Final = 1e-5  # of batch normalisation, as PyTorch
_PADDING: Final = 3  # rows of zeros before and after inputs, for the first layer; one around what other layers give

Arrays = Mapping[str, NDArray[Any]]


@compiled
def _layer(x: Any, parameters: Any, layer: Any, least: float) -> Any:
    """(count + 2, outside) convolution over time of (time + 2 padding, inside), `least` at least; padding is zero.

    A layer is (6,): width, inside, outside, samples from one output to the next, rows of padding, and where in the
    parameters its weights (width, inside, outside) begin, with its bias (outside,) behind them.
    """
    width, inside, outside, stride, padding, begin = layer[0], layer[1], layer[2], layer[3], layer[4], layer[5]
    count = (len(x) - 2 * padding + 2 * (width // 2) - width) // stride + 1
    out = np.zeros((count + 2, outside))
    span, first = width * inside, padding - width // 2
    if x.shape[1] != inside or first < 0 or first + (count - 1) * stride + width > len(x):
        raise ValueError("weights for other inputs")
    weight, bias = parameters[begin : begin + span * outside].reshape(span, outside), begin + span * outside
    flat, first, stride = x.ravel(), first * inside, stride * inside
    for t in range(count):
        for o in range(outside):
            out[t + 1, o] += parameters[bias + o]
    for j in range(0, span - 7, 8):  # eight products at a time: sums are loaded and stored an eighth as often
        for t in range(count):
            at = first + t * stride + j
            a, b, c, d = flat[at], flat[at + 1], flat[at + 2], flat[at + 3]
            e, f, g, h = flat[at + 4], flat[at + 5], flat[at + 6], flat[at + 7]
            for o in range(outside):
                one = (a * weight[j, o] + b * weight[j + 1, o]) + (c * weight[j + 2, o] + d * weight[j + 3, o])
                two = (e * weight[j + 4, o] + f * weight[j + 5, o]) + (g * weight[j + 6, o] + h * weight[j + 7, o])
                out[t + 1, o] += one + two
    for j in range(span - span % 8, span):
        for t in range(count):
            for o in range(outside):
                out[t + 1, o] += flat[first + t * stride + j] * weight[j, o]
    return np.maximum(out, least)


@compiled
def _outputs(x: Any, parameters: Any, layers: Any) -> Any:
    """Outputs of inputs (`WINDOW` + 2 `_PADDING`, `INPUTS`): of the last vector beside the mean of all."""
    for i in range(LAYERS):
        x = _layer(x, parameters, layers[i], 0.0)
    both = np.concatenate((x[-2], np.sum(x, axis=0) / (len(x) - 2)))  # the first and the last row are zero
    hidden = _layer(both.reshape(1, -1), parameters, layers[LAYERS], 0.0)[1]
    return _layer(hidden.reshape(1, -1), parameters, layers[LAYERS + 1], -math.inf)[1]


class CompiledNetwork:
    """The network of a phone.

    Args:
        arrays: Its weights by name.
        form: What their file says of it.
        path: Of that file, for messages.

    Raises:
        DatasetError: An array is missing or has another shape, or the network has another form.
    """

    def __init__(self, arrays: Arrays, form: Mapping[str, Any], path: Path) -> None:
        if form.get("arch") != CNN:
            raise DatasetError(f"{path}: {form.get('arch')!r} is no network of this version; train with `{TRAIN}`")
        check_form(form, INPUTS, path)
        try:
            self._take(arrays)
            self.ask(np.zeros((CHANNELS, WINDOW)), 0.0)  # fails where shapes do not fit
        except (KeyError, ValueError, IndexError, AssertionError) as error:
            raise DatasetError(
                f"{path}: these weights are of another network ({error}); train with `{TRAIN}`"
            ) from error

    def ask(self, features: FloatArray, height_m: float) -> WindowAnswer:
        """What is said of one window (`CHANNELS`, `WINDOW`); the height is that of the person, 0 where unknown."""
        x = np.zeros((WINDOW + 2 * _PADDING, INPUTS))
        x[_PADDING:-_PADDING, :CHANNELS] = features.T / self._scales
        if height_m > 0:
            x[_PADDING:-_PADDING, CHANNELS:] = (height_m - USUAL_HEIGHT_M[0]) / USUAL_HEIGHT_M[1], 1.0
        values = _outputs(x, self._parameters, self._layers)
        out, (low, high) = values.tolist(), LOG_SIGMA
        first, second = (self._claim * math.exp(min(max(out[i], low), high)) for i in (2, 4))
        cross = self._claim * min(max(out[3], -2.0), 2.0)
        return WindowAnswer(values[:2], np.array([[first, 0.0], [cross, second]]), out[5])

    def _take(self, arrays: Arrays) -> None:
        """Puts arrays in place, with what normalisation does to them."""
        layers: list[tuple[int, ...]] = []
        parameters: list[FloatArray] = []

        def add(weight: FloatArray, bias: FloatArray, stride: int = 1, padding: int = 0) -> None:
            matrix = np.atleast_3d(weight).transpose(2, 1, 0)
            if bias.shape != matrix.shape[2:] or len(matrix) % 2 == 0:
                raise ValueError(f"{len(bias)} values of bias for weights {matrix.shape}")
            layers.append((*matrix.shape, stride, padding, sum(map(len, parameters))))
            parameters.extend((matrix.ravel(), bias))

        for place in range(LAYERS):
            name, norm = f"layers.{place}.0", f"layers.{place}.1"
            spread = np.sqrt(arrays[f"{norm}.running_var"].astype(np.float64) + _NORM_EPSILON)
            factor = arrays[f"{norm}.weight"] / spread
            bias = arrays[f"{norm}.bias"] - arrays[f"{norm}.running_mean"] * factor
            add(arrays[f"{name}.weight"] * factor[:, None, None], bias, 2, 1 if place else _PADDING)
        for name in ("mix", "head"):
            add(arrays[f"{name}.weight"], arrays[f"{name}.bias"])
        self._claim, self._scales = float(arrays["claim"][0]), np.array(SCALES)
        self._layers, self._parameters = np.array(layers), np.concatenate(parameters).astype(np.float64)


def compiled_network(weights: str | None = None) -> CompiledNetwork:
    """The network that comes with pdrbench, known by its hash, or that of a file.

    Raises:
        DatasetError: The file is not what it should be.
    """
    path = PACKAGED if weights is None else Path(weights)
    return CompiledNetwork(*read_arrays(path, PACKAGED_SHA256 if weights is None else None), path)


def warm_up() -> None:
    """Compiles."""
    compiled_network()  # asked once while it is made
    grid_signals(np.zeros((2, 4)), np.zeros((2, 4)), np.zeros((2, 5)), 0.0, 0.0)
    yaw_means(np.ones((2, 5)), np.zeros((2, 4)), 1.0, 1.0, 1.0, (0.0, 0.0, 0.0, 0.0))
