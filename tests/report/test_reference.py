"""Generated pages: complete, and true to the code they are made from."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from pdrbench.registry import environments, localizers, make_task

DOCS = Path(__file__).resolve().parents[2] / "docs"

pytestmark = pytest.mark.skipif(not DOCS.is_dir(), reason="documentation is not part of a wheel")


@pytest.fixture
def reference(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module beside the hooks of the site, as these import it."""
    monkeypatch.syspath_prepend(DOCS)
    import reference

    return reference


def test_a_docstring_becomes_markdown_and_a_name_has_the_unit_of_its_suffix(reference: ModuleType) -> None:
    text = "Adds.\n\nArgs:\n    x_m: Metres,\n        or feet.\n\n>>> add(1)\n2"
    assert reference.docstring_markdown(text) == (
        "Adds.\n\n**Args**\n\n* `x_m`: Metres, or feet.\n\n```python\n>>> add(1)\n2\n```"
    )
    assert [reference.unit_of(name) for name in ("z_mps2", "access_point", "x")] == ["m/s²", "–", "–"]


def test_environment_page_states_the_facts_of_the_task(corridor: SimpleNamespace, reference: ModuleType) -> None:
    page = reference.environment_page(corridor.task(note="Not the registered data."))
    for fact in ("# Corridor-v0", "`(4, 2)`", "`stride_count`", "| train | 1 |", "| test | 6 |", "MIT"):
        assert fact in page
    assert "Not the registered data." in page
    assert "| `length_m` | m | 0 | 5 |" in page
    assert "A stride \\| of one foot." in page
    assert "**Radio survey**: none" in page


def test_environment_page_needs_no_recording(corridor: SimpleNamespace, reference: ModuleType) -> None:
    def never(walk: object) -> None:
        raise AssertionError(f"loaded {walk}")

    assert reference.environment_page(corridor.task(load=never, tell_start=never, start="unknown", radio_map=never))


def test_everything_registered_has_a_page_and_every_metric_a_line(reference: ModuleType) -> None:
    for name in environments():
        assert reference.environment_page(make_task(name)).startswith(f"# {name}\n")
    for name in localizers():
        page = reference.localizer_page(name)
        assert page.startswith(f"# {name}\n")
        assert len(page.splitlines()[2]) > 20, f"the docstring of {name} begins with a sentence"
    from pdrbench.metrics.table import METRICS

    page = reference.metrics_page()
    for name in METRICS:
        assert f"| `{name}` |" in page
