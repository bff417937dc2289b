"""Arrays that a training run keeps in its folder, with a manifest that says what they were made of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pdrbench.errors import PdrbenchError

Arrays = TypeVar("Arrays")


def kept(kind: type[Arrays], path: Path, manifest_path: Path, asked: Mapping[str, Any]) -> Arrays | None:
    """What `keep` wrote; None where it wrote nothing.

    Args:
        kind: A dataclass whose fields are arrays.
        path: Of the arrays.
        manifest_path: Of the manifest.
        asked: What they have to be made of.

    Raises:
        PdrbenchError: They were made of something else or by another version, or are torn.
    """
    if not (path.is_file() and manifest_path.is_file()):
        return None
    manifest = json.loads(manifest_path.read_text())
    if manifest["asked"] != asked:
        raise PdrbenchError(f"{path} was made of {manifest['asked']}, not of {asked}; give another folder")
    if hashlib.sha256(path.read_bytes()).hexdigest() != manifest["sha256"]:
        raise PdrbenchError(f"{path} is torn: its hash is not that of {manifest_path.name}; remove both")
    with np.load(path, allow_pickle=False) as stored:
        if set(stored.files) != {field.name for field in fields(kind)}:  # type: ignore[arg-type]
            raise PdrbenchError(f"{path} was made by another version; remove it and {manifest_path.name}")
        return kind(**stored)


def keep(arrays: Any, path: Path, manifest_path: Path, asked: Mapping[str, Any], **facts: Any) -> None:
    """Writes the fields of a dataclass of arrays, and a manifest with further facts."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, **{field.name: getattr(arrays, field.name) for field in fields(arrays)})
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    manifest_path.write_text(json.dumps({"asked": asked, "sha256": digest, **facts}, indent=1) + "\n")
