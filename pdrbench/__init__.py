"""pdrbench: the benchmark for indoor pedestrian localisation.

>>> import gymnasium, pdrbench
>>> env = gymnasium.make("pdrbench/CampusStride-v1")
>>> observation, info = env.reset(seed=0)
>>> info["briefing"].period_s
0.2
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pdrbench.gym.when_imported import register_when_imported

__version__ = "1.0.0"

if TYPE_CHECKING:
    from pdrbench.building import Building, FloorPolygon
    from pdrbench.episode import Episode
    from pdrbench.errors import PdrbenchError, UnsuitableError
    from pdrbench.evaluation import evaluate, replay, score
    from pdrbench.gym import check_localizer, check_task
    from pdrbench.learning.windows import windows
    from pdrbench.localizer import Briefing, Estimate, Localizer, Observation
    from pdrbench.recording import MagneticMap, RadioMap, Recording, SensorSpec, SensorStream
    from pdrbench.registry import make_localizer, make_task
    from pdrbench.result import Result
    from pdrbench.session import Session
    from pdrbench.task import Task
    from pdrbench.trajectory import Estimates, Start, Trajectory

_NAMES = {  # by module
    "building": ("Building", "FloorPolygon"),
    "episode": ("Episode",),
    "errors": ("PdrbenchError", "UnsuitableError"),
    "evaluation": ("evaluate", "replay", "score"),
    "gym": ("check_localizer", "check_task"),
    "learning.windows": ("windows",),
    "localizer": ("Briefing", "Estimate", "Localizer", "Observation"),
    "recording": ("MagneticMap", "RadioMap", "Recording", "SensorSpec", "SensorStream"),
    "registry": ("make_localizer", "make_task"),
    "result": ("Result",),
    "session": ("Session",),
    "task": ("Task",),
    "trajectory": ("Estimates", "Start", "Trajectory"),
}
_HOMES = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "Briefing",
    "Building",
    "Episode",
    "Estimate",
    "Estimates",
    "FloorPolygon",
    "Localizer",
    "MagneticMap",
    "Observation",
    "PdrbenchError",
    "RadioMap",
    "Recording",
    "Result",
    "SensorSpec",
    "SensorStream",
    "Session",
    "Start",
    "Task",
    "Trajectory",
    "UnsuitableError",
    "__version__",
    "check_localizer",
    "check_task",
    "evaluate",
    "make_localizer",
    "make_task",
    "replay",
    "score",
    "windows",
]


def __getattr__(name: str) -> Any:
    """Loads a public name when it is first asked for, so that importing pdrbench stays cheap."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pdrbench' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pdrbench.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)


register_when_imported()
