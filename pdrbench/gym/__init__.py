"""Gymnasium skins over episodes: the only room that imports gymnasium."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdrbench.gym.checking import Check
    from pdrbench.gym.env import LocalizationEnv, drive
    from pdrbench.gym.localizer_checks import check_localizer
    from pdrbench.gym.registration import NAMESPACE, register_environments
    from pdrbench.gym.spaces import to_action, to_observation
    from pdrbench.gym.task_checks import check_task
    from pdrbench.gym.wrappers import DenseWifi, RelativeAction, StartInObservation

_HOMES = {
    "NAMESPACE": "registration",
    "Check": "checking",
    "DenseWifi": "wrappers",
    "LocalizationEnv": "env",
    "RelativeAction": "wrappers",
    "StartInObservation": "wrappers",
    "check_localizer": "localizer_checks",
    "check_task": "task_checks",
    "drive": "env",
    "register_environments": "registration",
    "to_action": "spaces",
    "to_observation": "spaces",
}

__all__ = [
    "NAMESPACE",
    "Check",
    "DenseWifi",
    "LocalizationEnv",
    "RelativeAction",
    "StartInObservation",
    "check_localizer",
    "check_task",
    "drive",
    "register_environments",
    "to_action",
    "to_observation",
]


def __getattr__(name: str) -> Any:
    """Loads a public name when it is first asked for, so that importing pdrbench stays cheap."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pdrbench.gym' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pdrbench.gym.{_HOMES[name]}"), name)
