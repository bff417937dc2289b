"""Every example in a docstring runs with its stated output."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import pdrbench
import pdrbench_baselines
import pdrbench_envs

MODULES = sorted(
    found.name
    for package in (pdrbench, pdrbench_envs, pdrbench_baselines)
    for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not found.name.endswith("__main__")
)


@pytest.mark.parametrize("name", ["pdrbench", *MODULES])
def test_docstring_examples(name: str) -> None:
    failures, _ = doctest.testmod(importlib.import_module(name))
    assert failures == 0
