"""Packages that only adapters need."""

from __future__ import annotations

import importlib
from typing import Any, Final

from pdrbench.errors import UnsuitableError

INSTALL: Final = "pip install -c lab/outsiders-constraints.txt -e . -e 'lab[outsiders]'"  # apart: it has an older NumPy


def outside(module: str) -> Any:
    """A module of a package from outside.

    Raises:
        UnsuitableError: It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise UnsuitableError(
            f"needs the package {error.name}: run `{INSTALL}` in an environment of its own"
        ) from error
