"""Registers environments as soon as Gymnasium is there, and does not import it: that takes as long as all of ours."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any, Final

GYMNASIUM: Final = "gymnasium"


def register_when_imported() -> None:
    """Registers every environment: now where Gymnasium is imported, else at the end of its import."""
    if GYMNASIUM in sys.modules:
        _register()
    elif not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


def _register() -> None:
    from pdrbench.gym.registration import register_environments

    register_environments()


class _Finder(MetaPathFinder):
    """Finds Gymnasium as the finders behind it do, once; what loads it registers environments at its end."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != GYMNASIUM:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is not None and spec.loader is not None:
            loader: Any = spec.loader
            execute = loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                del loader.exec_module  # that of its class again, before environments are registered
                execute(module)
                _register()

            loader.exec_module = execute_and_register
        return spec
