"""Where registered files lie."""

from __future__ import annotations

from pathlib import Path

import pytest

from pdrbench.errors import DatasetError
from pdrbench_lab.readers.registered_files import locate


def test_a_missing_set_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    with pytest.raises(DatasetError, match="not available"):
        locate("phone_steps")
