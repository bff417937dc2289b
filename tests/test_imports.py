"""What `import pdrbench` loads, in a fresh interpreter."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

HEAVY = "gymnasium|numba|torch|matplotlib|pandas|scipy|sklearn|shapely|joblib|rich|typer"
LIGHT_ROOMS = ("recording", "task", "localizer", "building", "episode", "registry", "gym")


def imported_by(statement: str) -> list[str]:
    """Names of all modules loaded after a statement."""
    code = f"import sys, json; {statement}\nprint(json.dumps(sorted(sys.modules)))"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules: list[str] = json.loads(answer.stdout)
    return modules


def test_imports_nothing_heavy() -> None:
    modules = imported_by("; ".join(("import pdrbench", *(f"import pdrbench.{room}" for room in LIGHT_ROOMS))))
    assert "pdrbench" in modules
    assert [name for name in modules if name.partition(".")[0] in HEAVY.split("|")] == []


def test_loads_no_plug_in_beyond_its_table() -> None:
    modules = imported_by("import pdrbench")
    assert [name for name in modules if name.startswith(("pdrbench_envs.", "pdrbench_baselines."))] == []


@pytest.mark.parametrize("names", ["pdrbench, gymnasium", "gymnasium, pdrbench"])
def test_environments_are_registered_whatever_is_imported_first(names: str) -> None:
    statement = (
        f"import {names}, importlib.machinery as own; from pdrbench.registry import environments; "
        "assert environments() and all('pdrbench/' + name in gymnasium.registry for name in environments()); "
        "assert type(gymnasium.__spec__.loader) is own.SourceFileLoader"
    )
    assert "pdrbench.gym.env" not in imported_by(statement)
