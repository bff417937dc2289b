"""Networks in compiled code: memory, and weights that are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.compiled import CompiledNetwork, compiled_network
from pdrbench_baselines.learned.signals import CHANNELS, RATE_HZ, WINDOW
from pdrbench_baselines.learned.weight_files import PACKAGED, packaged_file, read_arrays


def windows(count: int = 12) -> FloatArray:
    """(count, `CHANNELS`, `WINDOW`): noise of several sizes, steps, rest, and one that begins with nothing."""
    rng, t_s = np.random.default_rng(7), np.arange(WINDOW) / RATE_HZ
    found: FloatArray = rng.standard_normal((count, CHANNELS, WINDOW)) * rng.choice([0.02, 0.5, 3.0], (count, 1, 1))
    for window, hz in zip(found[::2], rng.uniform(1.5, 2.2, count), strict=False):
        window[:3] += 3.0 * np.sin(2 * np.pi * hz * t_s + np.array([[0.0], [1.0], [2.0]]))
        window[6:9] = np.array([0.0, 0.6, 0.8])[:, None]
    found[0, :, :120] = 0.0
    return found


def test_it_remembers() -> None:
    network, (one, two, *_) = compiled_network("foot"), windows()
    _, memory = network.ask(one, 0.0, None)
    assert np.abs(network.ask(two, 0.0, memory)[0].move_m - network.ask(two, 0.0, None)[0].move_m).max() > 1e-3
    np.testing.assert_array_equal(memory, network.ask(one, 0.0, None)[1])


@pytest.mark.parametrize(
    ("packaged", "names"),
    [
        ("foot", ("trunk.0.weight", "trunk.6.way.weight", "memory.weight_hh_l0", "head.2.bias")),
        ("phone", ("layers.0.0.weight", "layers.3.1.running_var", "mix.weight", "claim")),
    ],
)
def test_other_weights_are_refused(packaged: str, names: tuple[str, ...], tmp_path: Path) -> None:
    path = packaged_file(packaged)
    arrays, form = read_arrays(path, PACKAGED[packaged])
    for name in names:
        with pytest.raises(DatasetError, match="of another network"):
            CompiledNetwork({key: value for key, value in arrays.items() if key != name}, form, path)
        cut = {key: value[..., :-1] if key == name else value for key, value in arrays.items()}
        with pytest.raises(DatasetError, match="of another network"):
            CompiledNetwork(cut, form, path)
    with pytest.raises(DatasetError, match="tcn"):
        CompiledNetwork(arrays, form | {"arch": "tcn"}, path)
    with pytest.raises(DatasetError, match="this version expects"):
        CompiledNetwork(arrays, form | {"rate_hz": 100.0}, path)
    with pytest.raises(DatasetError, match="sha256"):
        read_arrays(path, "0" * 64)
    with pytest.raises(DatasetError, match="cannot be read"):
        compiled_network(str(tmp_path / "none.safetensors"))
    (tmp_path / "text.safetensors").write_text(json.dumps(form))
    with pytest.raises(DatasetError, match="not the weights"):
        compiled_network(str(tmp_path / "text.safetensors"))
