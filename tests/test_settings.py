"""Settings in the name of a localizer, and names that are gone."""

from __future__ import annotations

from pathlib import Path

import pytest

from pdrbench import registry
from pdrbench.errors import UnknownNameError
from pdrbench.evaluation import evaluate
from pdrbench.registry import (
    ENVIRONMENTS_GROUP,
    LOCALIZERS_GROUP,
    PluginEntry,
    canonical_localizer,
    load_localizer,
    make_localizer,
    make_task,
)
from pdrbench.settings import SettingsError, sorted_query

FILE = """
from __future__ import annotations
import enum
from dataclasses import dataclass, field
from typing import Literal
import numpy as np
from pdrbench.localizer import Estimate

class Detector(enum.Enum):
    SHOE = "shoe"
    MV = "mv"

@dataclass(frozen=True)
class Filter:
    max_particles: int = 500
    seed_xy_m: tuple[float, ...] = (0.0, 1.5)

@dataclass(frozen=True)
class Params:
    kld: bool = True
    sigma_m: float = 5.0
    limit_m: float | None = None
    weights: str = "plain"
    detector: Detector = Detector.SHOE
    form: Literal["tree", "bush"] = "tree"
    table: np.ndarray | None = field(default=None)
    filter: Filter = Filter()

    def __post_init__(self):
        if self.sigma_m < 0:
            raise ValueError("sigma_m is at least 0")

class Mine:
    def __init__(self, params: Params = Params()):
        self.params = params
    def reset(self, briefing, rng):
        pass
    def step(self, observation):
        return Estimate(np.full(2, self.params.sigma_m), 0)

class Plain:
    def reset(self, briefing, rng):
        pass
    def step(self, observation):
        return Estimate(np.zeros(2), 0)

def made(params: Params = Params(weights="other")):
    return Mine(params)
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    return str(path)


@pytest.mark.parametrize(
    ("query", "field", "value"),
    [
        ("kld=false", "kld", False),
        ("sigma_m=0.25", "sigma_m", 0.25),
        ("sigma_m=1e-3", "sigma_m", 0.001),
        ("limit_m=2", "limit_m", 2.0),
        ("limit_m=none", "limit_m", None),
        ("weights=a%26b", "weights", "a&b"),
        ("weights=none", "weights", "none"),
        ("form=bush", "form", "bush"),
        ("filter.max_particles=20", "filter.max_particles", 20),
        ("filter.seed_xy_m=1,2.5", "filter.seed_xy_m", (1.0, 2.5)),
    ],
)
def test_a_setting_sets_a_field_to_a_value_of_its_type(file: str, query: str, field: str, value: object) -> None:
    found = make_localizer(f"{file}:Mine?{query}").params  # type: ignore[attr-defined]
    for part in field.split("."):
        found = getattr(found, part)
    assert found == value and type(found) is type(value)


def test_a_factory_has_defaults_of_its_own_and_a_localizer_without_params_no_settings(file: str) -> None:
    params = make_localizer(f"{file}:made?kld=false").params  # type: ignore[attr-defined]
    assert params.weights == "other" and not params.kld and params.detector.value == "shoe"
    assert make_localizer(f"{file}:made?detector=mv").params.detector.value == "mv"  # type: ignore[attr-defined]
    with pytest.raises(SettingsError, match=r"mine.py:Plain takes no settings; got \?kld=false"):
        make_localizer(f"{file}:Plain?kld=false")
    with pytest.raises(SettingsError, match="leave one of them out"):
        make_localizer(f"{file}:Mine?kld=false", params=None)


@pytest.mark.parametrize(
    ("query", "message"),
    [
        (
            "klt=false",
            r"Mine has no setting 'klt'; did you mean 'kld'\? its settings: detector, filter.max_particles, ",
        ),
        ("max_particles=5", r"did you mean 'filter.max_particles'\?"),
        ("kld=maybe", r"kld of .*Mine is bool, by default true; got 'maybe'"),
        ("limit_m=far", r"limit_m of .*Mine is float \| None, by default none; got 'far'"),
        ("form=rock", r"form of .*Mine is one of tree, bush, by default tree; got 'rock'"),
        ("filter.max_particles=1.5", r"filter.max_particles of .*Mine is int, by default 500; got '1.5'"),
        ("table=1", r"table of .*Mine is numpy.ndarray \| None, by default none; got .1."),
        ("sigma_m=-1", r"cannot have sigma_m=-1: sigma_m is at least 0"),
        ("kld", r"settings are written field=value, with & between them; got 'kld'"),
        ("kld=true&kld=false", r"the setting 'kld' stands twice"),
    ],
)
def test_what_cannot_be_set_says_what_can(file: str, query: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        load_localizer(f"{file}:Mine?{query}")


def test_the_stored_name_is_sorted_and_has_no_defaults(file: str) -> None:
    name = f"{file}:Mine?weights=a%26b&sigma_m=5&limit_m=2.0&filter.max_particles=20&kld=True"
    assert canonical_localizer(name, loads=True) == f"{file}:Mine?filter.max_particles=20&limit_m=2&weights=a%26b"
    assert canonical_localizer(f"{file}:Mine?kld=true", loads=True) == f"{file}:Mine"
    assert canonical_localizer(f"{file}:Mine?b=1&a=%41") == f"{file}:Mine?a=A&b=1", "a stranger's class is not loaded"
    assert sorted_query("b=1&a=2") == "a=2&b=1"


@pytest.mark.parametrize("isolation", ["none", "process"])
def test_a_walk_is_played_with_its_settings(file: str, isolation: str) -> None:
    env = "CampusStride-v1"
    names = [f"{file}:Mine?sigma_m=7&kld=false", f"{file}:Mine?kld=false&sigma_m=7", f"{file}:Mine"]
    results = evaluate(names, env, split="train", walks=1, seeds=1, isolation=isolation).results  # type: ignore[arg-type]
    found = {result.localizer: result for result in results}
    assert list(found) == [f"{file}:Mine?kld=false&sigma_m=7", f"{file}:Mine"]
    assert [result.status for result in results] == ["complete", "complete"], results[0].failure
    assert [set(result.estimates.xy_m.ravel()) for result in results] == [{7.0}, {5.0}]


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ids of a later time, and what became of former ones."""
    entries = {
        LOCALIZERS_GROUP: (
            ("fusion", "li2012", "stay"),
            {"fusion_smooth": "fusion", "li2012_nomap-v0": "li2012?map=false"},
        ),
        ENVIRONMENTS_GROUP: (("Office-v2", "Office-v10", "Ipin-v1"), {"Ipin2023-v0": "Ipin-v1"}),
    }

    def scan(group: str) -> object:
        names, renamed = entries[group]
        return {name: PluginEntry(name, "no_such_package:Thing", "pdrbench") for name in names}, {}, renamed

    monkeypatch.setattr(registry, "_scan", scan)


@pytest.mark.usefixtures("tables")
@pytest.mark.parametrize(
    ("name", "now"),
    [
        ("stay-v0", "'stay-v0' is now 'stay'"),
        ("fusion-v2", "'fusion-v2' is now 'fusion'"),
        ("fusion-v2?map=false", r"'fusion-v2\?map=false' is now 'fusion\?map=false'"),
        ("fusion_smooth-v1", "'fusion_smooth-v1' is now 'fusion'"),
        ("li2012_nomap-v0", r"'li2012_nomap-v0' is now 'li2012\?map=false'"),
        ("li2012_nomap-v0?num=5", r"is now 'li2012\?map=false&num=5'"),
    ],
)
def test_a_former_localizer_names_what_it_is_now(name: str, now: str) -> None:
    for look in (load_localizer, canonical_localizer):
        if "?" in name or look is load_localizer:
            with pytest.raises(UnknownNameError, match=now):
                look(name)


@pytest.mark.usefixtures("tables")
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Office-v1", "'Office-v1' is now 'Office-v10'"),
        ("Ipin2023-v0", "'Ipin2023-v0' is now 'Ipin-v1'"),
        ("Office-v11", r"did you mean 'Office-v10'\?"),
    ],
)
def test_a_former_environment_names_the_number_of_today(name: str, message: str) -> None:
    with pytest.raises(UnknownNameError, match=message):
        make_task(name)
