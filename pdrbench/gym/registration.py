"""Registers environments with Gymnasium."""

from __future__ import annotations

import warnings
from typing import Final, NoReturn

import gymnasium

from pdrbench.registry import ENVIRONMENTS_GROUP, environments, renamed

NAMESPACE: Final = "pdrbench"


def register_environments() -> None:
    """Registers every environment with Gymnasium as `pdrbench/<id>`, by string: nothing is imported.

    A former id is registered too, and so is each without `pdrbench/`: making it raises an error that names the right
    one.

    What is registered already stays as it is. An id that Gymnasium refuses is warned of and left out.
    """
    for name in (*environments(), *renamed(ENVIRONMENTS_GROUP)):
        full_name = f"{NAMESPACE}/{name}"
        if full_name in gymnasium.registry:
            continue
        try:
            gymnasium.register(name, "pdrbench.gym.registration:refuse_bare_name", kwargs={"name": name})
            gymnasium.register(id=full_name, entry_point="pdrbench.gym.env:LocalizationEnv", kwargs={"task": name})
        except gymnasium.error.Error as error:
            warnings.warn(f"environment {name!r} is not registered with gymnasium: {error}", stacklevel=2)


def refuse_bare_name(name: str, **_settings: object) -> NoReturn:
    """Raises for an id without `pdrbench/`, whatever else `gymnasium.make` was given."""
    raise gymnasium.error.NameNotFound(f"{name} lacks its namespace: gymnasium.make({f'{NAMESPACE}/{name}'!r})")
