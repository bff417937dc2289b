"""The page on policies is correct: its blocks run in their order, and the policy has learned something."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "learning.md"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_a_policy_learns_to_add_strides() -> None:
    """As the page says: far below standing still, and near to adding the strides without an error of its own."""
    pytest.importorskip("stable_baselines3")
    namespace: dict[str, Any] = {}
    for block in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        exec(compile(block, "learning.md", "exec"), namespace)
    learned_m, means_m = namespace["learned_m"], namespace["means_m"]
    assert learned_m < 0.4 * means_m["stay"]
    assert learned_m < 1.5 * means_m["dead_reckoning"]
