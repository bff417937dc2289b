"""The recurrent zero-velocity detector: six layers of 80 units, trained by `zero_velocity_train`."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray

LAYERS: Final = 6  # of Wagstaff & Kelly 2018, as are the units and the window
UNITS: Final = 80
CHANNELS: Final = 6  # specific force, rate
SCALES: Final = (10.0, 10.0, 10.0, 3.0, 3.0, 3.0)  # ours: m/s2, rad/s of a foot that walks
# sha256 of the weights that come with pdrbench, by name
PACKAGED: Final = {"foot_ins_lstm": "9172be9ecf020c46f675fa2ac5d886b138758919345873976c8cfe2e8ef3ad68"}


class ZeroVelocityNetwork(nn.Module):
    """Six recurrent layers of 80 units, and for every sample a logit of rest."""

    def __init__(self) -> None:
        super().__init__()
        self.lstm = nn.LSTM(CHANNELS, UNITS, LAYERS, batch_first=True)
        self.fc = nn.Linear(UNITS, 1)
        self.scale: Tensor
        self.register_buffer("scale", torch.tensor(SCALES), persistent=False)

    def forward(self, rows: Tensor, memory: Any = None) -> tuple[Tensor, Any]:
        """Logits (N, T) of rows (N, T, 6), and the memory after them."""
        out, memory = self.lstm(rows / self.scale, memory)
        return self.fc(out)[:, :, 0], memory

    def probabilities(self, rows: FloatArray, memory: Any = None) -> tuple[FloatArray, Any]:
        """(n,) probabilities of rest of samples (n, 6) at 200 Hz, and the memory after them."""
        with torch.inference_mode():
            logits, memory = self(torch.from_numpy(rows.astype(np.float32))[None], memory)
            return torch.sigmoid(logits[0]).numpy().astype(np.float64), memory


def store(network: ZeroVelocityNetwork, path: Path) -> str:
    """Writes a network in 16 bits; returns the sha256 of the file."""
    content = save({name: values.half().contiguous() for name, values in network.state_dict().items()})
    path.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def packaged(name: str) -> ZeroVelocityNetwork:
    """One of the networks in `PACKAGED`, known by its hash."""
    return restore(Path(__file__).with_name(f"{name}.safetensors"), PACKAGED[name])


def restore(path: Path, sha256: str | None = None) -> ZeroVelocityNetwork:
    """A network as it was stored, ready to be asked.

    Raises:
        DatasetError: No such file, another hash, or not the weights of this network.
    """
    try:
        content = path.read_bytes()
        came = hashlib.sha256(content).hexdigest()
        if sha256 is not None and came != sha256:
            raise DatasetError(f"{path}: sha256 is {came[:12]}..., expected {sha256[:12]}...; install pdrbench again")
        stored = load(content)
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from error
    except SafetensorError as error:
        raise DatasetError(f"{path}: not the weights of a zero-velocity network ({error})") from error
    with torch.random.fork_rng(devices=[]):
        network = ZeroVelocityNetwork()
    own = network.state_dict()
    if {name: values.shape for name, values in own.items()} != {name: values.shape for name, values in stored.items()}:
        raise DatasetError(f"{path}: not the weights of a zero-velocity network (other names or shapes)")
    network.load_state_dict({name: values.float() for name, values in stored.items()})
    return network.eval()
