"""The network in compiled code: weights that are refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pdrbench.errors import DatasetError
from pdrbench_baselines.learned.compiled import CompiledNetwork, compiled_network
from pdrbench_baselines.learned.weight_files import PACKAGED, PACKAGED_SHA256, read_arrays


def test_other_weights_are_refused(tmp_path: Path) -> None:
    path = PACKAGED
    arrays, form = read_arrays(path, PACKAGED_SHA256)
    for name in ("layers.0.0.weight", "layers.3.1.running_var", "mix.weight", "claim"):
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
