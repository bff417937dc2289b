"""Files of the evaluator, of environments and of the user."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

import numpy as np

import pdrbench
from hostile.common import FILES, HIDDEN, READ_ONLY, Attempt, Probe, can_open
from hostile.targets import TARGETS


class ReadsData(Probe):
    def attempts(self) -> dict[str, Attempt]:
        return {
            "data": (lambda: can_open(TARGETS["data_file"]), FILES | HIDDEN),
            "data-listed": (lambda: list(Path(TARGETS["data"]).iterdir()), FILES | HIDDEN),
            "secret": (lambda: can_open(TARGETS["secret_file"]), FILES),
            "results": (lambda: can_open(next(Path(TARGETS["results"]).iterdir())), FILES),
            "environment": (lambda: can_open(TARGETS["env_source"]), FILES | HIDDEN),
            "simulator": (lambda: can_open(TARGETS["simulator_source"]), FILES | HIDDEN),
            "simulator-compiled": (lambda: can_open(TARGETS["simulator_compiled"]), FILES | HIDDEN),
            "plugin": (lambda: can_open(TARGETS["plugin_source"]), FILES),
            "homes": (lambda: [*Path("/root").iterdir(), *Path("/home").iterdir()], FILES),
            "shadow": (lambda: can_open("/etc/shadow"), FILES),
        }


class EditsEvaluator(Probe):
    """Opens files of the evaluator for writing, without writing."""

    def attempts(self) -> dict[str, Attempt]:
        core = Path(pdrbench.__file__)
        return {
            "pdrbench": (lambda: can_open(core, os.O_RDWR), FILES | READ_ONLY),
            "numpy": (lambda: can_open(np.__file__, os.O_RDWR), FILES | READ_ONLY),
            "pdrbench-new": (lambda: can_open(core.with_name("planted.py"), os.O_RDWR | os.O_CREAT), FILES | READ_ONLY),
            "results-new": (
                lambda: can_open(Path(TARGETS["results"]) / "planted.result", os.O_RDWR | os.O_CREAT),
                FILES | READ_ONLY,
            ),
            "results": (
                lambda: can_open(next(Path(TARGETS["results"]).glob("*.result")), os.O_RDWR),
                FILES | READ_ONLY,
            ),
            "numba": (lambda: can_open(Path(TARGETS["numba"]) / "planted", os.O_RDWR | os.O_CREAT), FILES),
            "itself": (lambda: can_open(__file__, os.O_RDWR), FILES | READ_ONLY),
            "home": (lambda: can_open(Path(TARGETS["home"]) / "planted", os.O_RDWR | os.O_CREAT), FILES | READ_ONLY),
            "shm": (lambda: can_open(Path("/dev/shm") / f"planted-{os.getpid()}", os.O_RDWR | os.O_CREAT), FILES),
        }


class ImportsEnvironment(Probe):
    """Any process with the code and the walk's name can generate the walk again."""

    def attempts(self) -> dict[str, Attempt]:
        return {
            "ours": (lambda: importlib.import_module("pdrbench_envs.campus.environment"), FILES | HIDDEN),
            "simulator": (lambda: importlib.import_module("pdrbench_sim.people.walk"), FILES | HIDDEN),
            "plugin": (lambda: importlib.import_module("corridor_plugin"), FILES),
            "loads-ours": (lambda: self.loads("CampusStride-v1"), FILES | HIDDEN),
            "loads-plugin": (lambda: self.loads("Corridor-v0"), FILES),
        }

    def loads(self, env: str) -> bool:
        from pdrbench.registry import make_task

        task = make_task(env)
        return bool(task.load(task.walks["test"][0]).reference)
