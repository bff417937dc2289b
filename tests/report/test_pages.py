"""Generated pages: complete, and true to the code they are made from."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from pdrbench.registry import environments, localizers, make_task
from pdrbench.report import environment_page, localizer_page, metrics_page


def test_environment_page_states_the_facts_of_the_task(corridor: SimpleNamespace) -> None:
    page = environment_page(corridor.task(note="Not the registered data."))
    for fact in ("# Corridor-v0", "`(4, 2)`", "`stride_count`", "| train | 1 |", "| test | 6 |", "MIT"):
        assert fact in page
    assert "Not the registered data." in page
    assert "| `length_m` | m | 0 | 5 |" in page
    assert "A stride \\| of one foot." in page
    assert "**Radio survey**: none" in page


def test_environment_page_needs_no_recording(corridor: SimpleNamespace) -> None:
    def never(walk: object) -> None:
        raise AssertionError(f"loaded {walk}")

    assert environment_page(corridor.task(load=never, tell_start=never, start="unknown", radio_map=never))


@pytest.mark.parametrize("name", sorted(environments()))
def test_every_registered_environment_has_a_page(name: str) -> None:
    assert environment_page(make_task(name)).startswith(f"# {name}\n")


@pytest.mark.parametrize("name", sorted(localizers()))
def test_every_registered_localizer_has_a_page(name: str) -> None:
    page = localizer_page(name)
    assert page.startswith(f"# {name}\n")
    assert len(page.splitlines()[2]) > 20, "its docstring begins with a sentence"


def test_every_metric_has_a_line() -> None:
    from pdrbench.metrics.table import METRICS

    page = metrics_page()
    for name in METRICS:
        assert f"| `{name}` |" in page
