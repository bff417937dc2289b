"""Registers environments with Gymnasium."""

from __future__ import annotations

import warnings
from typing import Final

import gymnasium

from pdrbench.registry import ENVIRONMENTS_GROUP, environments, renamed

NAMESPACE: Final = "pdrbench"


def register_environments() -> None:
    """Registers every environment with Gymnasium as `pdrbench/<id>`, by string: nothing is imported.

    A former id is registered too, and making it raises an error that names the new one.

    What is registered already stays as it is. An id that Gymnasium refuses is warned of and left out.
    """
    for name in (*environments(), *renamed(ENVIRONMENTS_GROUP)):
        full_name = f"{NAMESPACE}/{name}"
        if full_name in gymnasium.registry:
            continue
        try:
            gymnasium.register(
                id=full_name,
                entry_point="pdrbench.gym.env:LocalizationEnv",
                vector_entry_point="pdrbench.gym.vector:LocalizationVectorEnv",
                kwargs={"task": name},
            )
        except gymnasium.error.Error as error:
            warnings.warn(f"environment {name!r} is not registered with gymnasium: {error}", stacklevel=2)
