from __future__ import annotations

import subprocess
import sys
import textwrap

import gymnasium
import pytest
from installed import declare

from pdrbench.registry import environments, make_task


def test_every_environment_is_registered_by_string() -> None:
    ours = [name for name, entry in environments().items() if entry.package == "pdrbench"]
    assert len(ours) > 5
    for name in ours:
        spec = gymnasium.registry[f"pdrbench/{name}"]
        assert spec.entry_point == "pdrbench.gym.env:LocalizationEnv"
        assert spec.kwargs == {"task": name}


@pytest.mark.parametrize("module", ["raise RuntimeError('on import')", "ENVIRONMENTS = {'no id': 'a:b'}"])
def test_a_broken_plug_in_does_not_break_the_import(tmp_path, module) -> None:
    (tmp_path / "broken_plugin.py").write_text(module)
    declare(tmp_path, "broken_plugin", "[pdrbench.environments]\nbroken = broken_plugin:ENVIRONMENTS\n")
    code = """
        import sys, warnings
        sys.path.insert(0, sys.argv[1])
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            import gymnasium, pdrbench
        from pdrbench.registry import ENVIRONMENTS_GROUP, broken
        assert any(name.startswith("pdrbench/") for name in gymnasium.registry)
        print([str(warning.message) for warning in caught], dict(broken(ENVIRONMENTS_GROUP)))
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "broken" in done.stdout or "'no id'" in done.stdout


def test_an_environment_of_a_task_object_has_a_spec() -> None:
    task = make_task("CampusStride-v1")
    env = gymnasium.make("pdrbench/CampusStride-v1", task=task, split="train")
    assert env.spec is not None and env.spec.id == "pdrbench/CampusStride-v1"
    assert env.spec.kwargs["task"] is task


@pytest.mark.parametrize("name", ["CampusStride-v1", "OfficeStride-v0"])
def test_an_id_without_its_namespace_is_refused_with_the_right_one(name: str) -> None:
    with pytest.raises(
        gymnasium.error.NameNotFound, match=rf"lacks its namespace: gymnasium\.make\('pdrbench/{name}'\)"
    ):
        gymnasium.make(name, split="train")
