"""Recorded sets of the laboratory are told from other files that look like them."""

from __future__ import annotations

from pathlib import Path

import pytest

from pdrbench_formats.detect import detect


@pytest.mark.data
@pytest.mark.parametrize(
    ("pattern", "kind"),
    [
        ("foot_loops/*/data_inert.txt", "foot_loops"),
        ("foot_short/*.csv", "foot_short"),
        ("phone_steps/data/*", "phone_steps"),
    ],
)
def test_recorded_sets_are_distinguished(data_root: Path, pattern: str, kind: str) -> None:
    found = sorted(data_root.glob(pattern))
    assert found
    assert {detect(path) for path in found} == {kind}
