from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest

from pdrbench import registry
from pdrbench.errors import UnknownNameError
from pdrbench.registry import PluginEntry, PluginError, Table, load_localizer, make_localizer, make_task

GOOD = """
from pdrbench.localizer import Estimate
import numpy as np

class Mine:
    def __init__(self, level=0):
        self.level = level
    def reset(self, briefing, rng):
        pass
    def step(self, observation):
        return Estimate(np.zeros(2), self.level)

class Half:
    def reset(self, briefing, rng):
        pass

value = 7
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "my_localizer.py"
    path.write_text(GOOD)
    return path


def test_a_localizer_from_a_file_takes_parameters_and_is_read_again_when_edited(file: Path) -> None:
    localizer = make_localizer(f"{file}:Mine", level=3)
    assert localizer.step(None).level == 3  # type: ignore[arg-type]
    before = load_localizer(f"{file}:Mine")
    file.write_text(GOOD.replace("level=0", "level=5"))
    assert load_localizer(f"{file}:Mine") is not before
    assert make_localizer(f"{file}:Mine").level == 5  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("{file}:Other", "defines no 'Other'"),
        ("{file}:value", "is int, not a class"),
        ("{file}", r"names a file and no class in it; write .*\.py:Class"),
        ("{file}:", "names a file and no class"),
        ("{file}:Half", r"lacks reset\(briefing, rng\) or step\(observation\)"),
        ("{file}.gone.py:Mine", "no file"),
        ("no_such_package.module:Mine", "ModuleNotFoundError"),
        ("math:Mine", "AttributeError"),
    ],
)
def test_localizers_that_cannot_be_loaded_say_why(file: Path, name: str, message: str) -> None:
    with pytest.raises(PluginError, match=message):
        make_localizer(name.format(file=file))


@pytest.mark.parametrize(
    "content", ["raise RuntimeError('no')", "def (", "import torch_of_tomorrow", "raise SystemExit"]
)
def test_a_file_that_fails_to_import_is_named(tmp_path: Path, content: str) -> None:
    path = tmp_path / "broken.py"
    path.write_text(content)
    with pytest.raises(PluginError, match=r"broken\.py cannot be loaded"):
        load_localizer(f"{path}:Mine")


def test_the_prefix_of_gymnasium_is_understood() -> None:
    assert make_task("pdrbench/CampusStride-v1") == make_task("CampusStride-v1")


def test_a_task_that_calls_itself_otherwise_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = PluginEntry("Other-v0", "pdrbench_envs.campus.environment:task_stride", "a_package")
    monkeypatch.setattr(registry, "environments", lambda: {"Other-v0": entry})
    with pytest.raises(PluginError, match="calls itself 'CampusStride-v1'"):
        make_task("Other-v0")


def not_an_environment() -> None:
    raise ZeroDivisionError("no such place")


def test_a_task_function_that_raises_is_a_broken_plug_in(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = PluginEntry("Torn-v0", f"{__name__}:not_an_environment", "a_package")
    monkeypatch.setattr(registry, "environments", lambda: {"Torn-v0": entry})
    monkeypatch.setattr(PluginEntry, "load", lambda self: not_an_environment)
    with pytest.raises(PluginError, match=r"'Torn-v0' from a_package: .* raised ZeroDivisionError: no such place"):
        make_task("Torn-v0")


@pytest.mark.parametrize("name", [None, 3])
def test_a_value_that_is_no_name_is_an_unknown_name(name: object) -> None:
    with pytest.raises(UnknownNameError, match=f"no split of CampusStride-v1 named {name}"):
        make_task("CampusStride-v1").split(name)  # type: ignore[arg-type]


def test_an_id_that_is_taken_and_a_table_that_is_none_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def points(group: str) -> list[EntryPoint]:
        values = {"builtin": "pdrbench.sensors:BUILTIN", "other": f"{__name__}:TAKEN", "third": "math:pi"}
        return [EntryPoint(name, value, group) for name, value in values.items()]

    monkeypatch.setitem(sys.modules, __name__, SimpleNamespace(TAKEN={"accel": "other:ACCEL", "new": "other:NEW"}))
    monkeypatch.setattr(registry, "entry_points", points)
    sensors: Table[object] = Table("pdrbench.test_sensors", "sensor", {})
    reasons = sensors.broken()
    assert any("'accel' is already registered by pdrbench.sensors" in why for why in reasons.values())
    assert any("must name a dict" in why for why in reasons.values())
    assert "ModuleNotFoundError" in reasons["new"] and "gyro" in sensors and "gyro" not in reasons
