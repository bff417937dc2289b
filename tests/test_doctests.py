"""Every example in a docstring runs with its stated output."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import pdrbench
import pdrbench_baselines
import pdrbench_envs

MODULES = [
    ".".join([package.__name__, *file.relative_to(root).with_suffix("").parts]).removesuffix(".__init__")
    for package in (pdrbench, pdrbench_envs, pdrbench_baselines)
    for root in map(Path, package.__path__)
    for file in sorted(root.rglob("*.py"))
    if ">>> " in file.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", MODULES)
def test_docstring_examples(name: str) -> None:
    failures, attempted = doctest.testmod(importlib.import_module(name))
    assert attempted and not failures
