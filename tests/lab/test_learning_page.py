"""The page on policies is correct: its blocks run in order, and the policy has learned. The notebook beside it."""

from __future__ import annotations

import ast
import json
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


def test_the_notebook_is_small_and_plain() -> None:
    """`.ci/run-notebook` runs it; here are its size, its texts and what came out of its cells."""
    path = PAGE.with_name("learning.ipynb")
    assert path.stat().st_size < 300_000
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    texts = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown"]
    prose = re.sub(r"```.*?```|`[^`]*`", "Code", "\n\n".join(texts), flags=re.DOTALL)
    sentences = re.split(r"(?<=[.!?:])\s+|\n\n", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", prose))
    assert [sentence for sentence in sentences if len(sentence.split()) > 25] == []
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", "\n".join(texts))
    assert [link for link in links if not (link.startswith("http") or (PAGE.parent / link).is_file())] == []
    codes = [cell for cell in cells if cell["cell_type"] == "code"]
    for cell in codes:
        first, _, rest = "".join(cell["source"]).partition("\n")
        if not first.startswith("%%bash"):
            ast.parse(rest if first.startswith("%%writefile ") else f"{first}\n{rest}")
    assert {out["output_type"] for cell in codes for out in cell["outputs"]} <= {
        "stream",
        "display_data",
        "execute_result",
    }
