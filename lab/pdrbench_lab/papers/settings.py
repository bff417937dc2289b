"""Settings of experiments: a record of which some fields are changed by name, records in it too."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar

from pdrbench.errors import unknown_name

T = TypeVar("T")


def merged(defaults: T, changes: T | Mapping[str, Any] | None, what: str) -> T:
    """A frozen record with some fields changed.

    Args:
        defaults: The record; a field may hold a record of its own.
        changes: Fields by name, as JSON or a command line knows them; a mapping changes fields of a record in it. A
            whole record is taken as it is, None changes nothing.
        what: Whose parameters they are, for the message of an error.

    Raises:
        UnknownNameError: No such field.
    """
    if changes is None:
        return defaults
    if not isinstance(changes, Mapping):
        return changes
    known = [field.name for field in dataclasses.fields(defaults)]  # type: ignore[arg-type]
    values = {}
    for name, value in changes.items():
        if name not in known:
            raise unknown_name(f"parameter of {what}", name, known)
        old = getattr(defaults, name)
        is_record = dataclasses.is_dataclass(old) and isinstance(value, Mapping)
        values[name] = merged(old, value, what) if is_record else value
    return dataclasses.replace(defaults, **values)  # type: ignore[type-var]
