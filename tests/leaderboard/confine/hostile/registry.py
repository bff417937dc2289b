"""Hostile localizers by name."""

from __future__ import annotations

import importlib
import inspect

from hostile.common import Honest, Probe

MODULES = (
    *("answers", "endings", "time_wasters", "bombs", "output", "forged", "two_pass"),
    *("files", "processes", "sockets", "notes", "exfiltration"),
)
BASES = {"Honest", "Probe", "Forger", "ForgerThatRests", "TwoPass"}  # attack nothing themselves


def localizers() -> dict[str, type[Honest]]:
    """Every class that attacks, in the order of the modules."""
    found = {}
    for name in MODULES:
        module = importlib.import_module(f"hostile.{name}")
        for kind in vars(module).values():
            is_ours = inspect.isclass(kind) and issubclass(kind, Honest) and kind.__module__ == module.__name__
            if is_ours and kind.__name__ not in BASES:
                found[kind.__name__] = kind
    return found


def probes() -> dict[str, type[Probe]]:
    """Those that report which of their attempts succeeded."""
    return {name: kind for name, kind in localizers().items() if issubclass(kind, Probe)}
