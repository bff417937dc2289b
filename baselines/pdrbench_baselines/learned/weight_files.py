"""Files of weights, as safetensors, read without PyTorch: only where their hash is the expected one."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load

from pdrbench.errors import DatasetError
from pdrbench_baselines.learned.signals import HORIZON, RATE_HZ, WINDOW

PACKAGED: Final = Path(__file__).with_name("phone.safetensors")
PACKAGED_SHA256: Final = "4fb0f69f499b909ea48f68bc8847bcdb29d9b30178a392dbf01ea01fd5699abd"
FORM: Final = {"window": WINDOW, "horizon": HORIZON, "rate_hz": RATE_HZ}
TRAIN: Final = "python -m pdrbench_lab.learned train --out DIR"


def read_arrays(
    path: Path, sha256: str | None, *, train: str = TRAIN, otherwise: str = ""
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Arrays of a file by name, and what it says of their network; nothing where it says nothing.

    Args:
        path: Of the file.
        sha256: It has to have; None for any.
        train: Command that makes such a file, for messages.
        otherwise: What else helps where the hash is another.

    Raises:
        DatasetError: No such file, another hash, or not safetensors at all.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}; train with `{train}`") from error
    came = hashlib.sha256(content).hexdigest()
    if sha256 is not None and came != sha256:
        wanted = f"expected {sha256[:12]}...; install pdrbench again{otherwise}"
        raise DatasetError(f"{path}: sha256 is {came[:12]}..., {wanted}")
    try:
        (length,) = struct.unpack("<Q", content[:8])
        arrays, header = load(content), json.loads(content[8 : 8 + length])
        form = json.loads(header.get("__metadata__", {}).get("network", "{}"))
    except (SafetensorError, ValueError, struct.error) as error:
        raise DatasetError(f"{path}: not the weights of a network ({error}); train with `{train}`") from error
    return arrays, form if isinstance(form, dict) else {}


def check_form(form: Mapping[str, Any], inputs: int, path: Path) -> None:
    """Raises `DatasetError` where a network was made for other windows than those of this version."""
    expected = {"inputs": inputs, **FORM}
    other = {name: form.get(name) for name, value in expected.items() if form.get(name) != value}
    if other:
        raise DatasetError(f"{path}: made for {other}, this version expects {expected}; train anew with `{TRAIN}`")
