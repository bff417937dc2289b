"""Networks in compiled code say what PyTorch says, and need none of it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.compiled import CompiledNetwork, compiled_network
from pdrbench_baselines.learned.signals import CHANNELS, RATE_HZ, WINDOW
from pdrbench_baselines.learned.weight_files import PACKAGED, packaged_file, read_arrays

WITHOUT_TORCH = """
import sys
sys.modules["torch"] = None  # importing it is an error
from pdrbench.registry import make_localizer
from pdrbench_baselines.learned.compiled import compiled_network
make_localizer("fusion-v2")
print(compiled_network("learned-v2").own_attitude)
"""


def windows(count: int = 12) -> FloatArray:
    """(count, `CHANNELS`, `WINDOW`): noise of several sizes, steps, rest, and one that begins with nothing."""
    rng, t_s = np.random.default_rng(7), np.arange(WINDOW) / RATE_HZ
    found: FloatArray = rng.standard_normal((count, CHANNELS, WINDOW)) * rng.choice([0.02, 0.5, 3.0], (count, 1, 1))
    for window, hz in zip(found[::2], rng.uniform(1.5, 2.2, count), strict=False):
        window[:3] += 3.0 * np.sin(2 * np.pi * hz * t_s + np.array([[0.0], [1.0], [2.0]]))
        window[6:9] = np.array([0.0, 0.6, 0.8])[:, None]
    found[0, :, :120] = 0.0
    return found


@pytest.mark.parametrize("weights", sorted(PACKAGED))
@pytest.mark.parametrize("height_m", [0.0, 1.85])
def test_it_says_what_pytorch_says(weights: str, height_m: float) -> None:
    pytest.importorskip("torch", reason="needs the extra `learned`")
    from pdrbench_baselines.learned.localizer import load_network

    mine, theirs = compiled_network(weights), load_network(weights)
    assert (mine.carried, mine.own_attitude) == (theirs.carried, theirs.own_attitude)
    memory, remembered = None, None
    for window in windows():
        one, memory = mine.ask(window, height_m, memory)
        other, remembered = theirs.ask(window, height_m, remembered)
        # float32 has 24 bits: a sum of some thousand terms of 1 is off by 1e-5 at most
        np.testing.assert_allclose(one.move_m, other.move_m, atol=1e-5)
        np.testing.assert_allclose(one.cholesky_m, other.cholesky_m, atol=1e-5)
        np.testing.assert_allclose(memory, remembered.numpy().ravel(), atol=1e-5)
        assert one.standing == pytest.approx(other.standing, abs=1e-4)
        assert one.length_m == pytest.approx(other.length_m, abs=1e-5)
        assert one.rhythm == pytest.approx(other.rhythm, abs=1e-5, nan_ok=True)
        assert (one.doubt is None) == (other.doubt is None)
        assert other.doubt is None or one.doubt == pytest.approx(other.doubt, abs=1e-4)
    assert np.ptp([mine.ask(window, height_m, None)[0].length_m for window in windows()]) > 0.1  # it is no constant


def test_it_remembers() -> None:
    network, (one, two, *_) = compiled_network("learned-v1"), windows()
    _, memory = network.ask(one, 0.0, None)
    assert np.abs(network.ask(two, 0.0, memory)[0].move_m - network.ask(two, 0.0, None)[0].move_m).max() > 1e-3
    np.testing.assert_array_equal(memory, network.ask(one, 0.0, None)[1])


def test_it_needs_no_pytorch() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT_TORCH], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "True", done.stderr


def test_other_weights_are_refused(tmp_path: Path) -> None:
    path = packaged_file("learned-v2")
    arrays, form = read_arrays(path, PACKAGED["learned-v2"])
    for name in ("trunk.0.weight", "trunk.6.way.weight", "memory.weight_hh_l0", "head.2.bias", "whitening"):
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
        read_arrays(path, PACKAGED["learned-v1"])
    with pytest.raises(DatasetError, match="cannot be read"):
        compiled_network(str(tmp_path / "none.safetensors"))
    (tmp_path / "text.safetensors").write_text(json.dumps(form))
    with pytest.raises(DatasetError, match="not the weights"):
        compiled_network(str(tmp_path / "text.safetensors"))
