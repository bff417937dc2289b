"""The report folder: its files, with the scored errors of every localizer."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from pdrbench.errors import PdrbenchError
from pdrbench.picture import estimate_style
from pdrbench.report import FigureOptions
from pdrbench.report import folder as folder_module
from pdrbench.report.folder import SplitResults, errors_of, write_report
from pdrbench.report.walks import draw_walk, levels_to_show


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels take most of the time of a picture."""
    monkeypatch.setattr(folder_module, "DPI", 40)


@pytest.fixture
def part(corridor: SimpleNamespace) -> SplitResults:
    near = [corridor.result("near", walk, 1.0 + i, seed) for i, walk in enumerate(corridor.WALKS) for seed in (0, 1)]
    return SplitResults(corridor.task(), "test", tuple(near), tuple(map(corridor.scored, near)))


def test_everything_is_written_and_can_be_opened(results: Any, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "report"
    written = write_report(results, folder)
    assert sorted(path.name for path in written) == sorted(path.name for path in folder.iterdir())
    names = {path.name for path in written}
    assert names >= {"table.md", "table.tex", "table.csv", "rows.json"}
    assert names >= {"Corridor-v0-cdf.png", "Corridor-v0-cdf.pdf", "Corridor-v0-walk-1.png"}
    assert "Corridor-v0-walk-5.png" not in names
    for path in written:
        assert path.stat().st_size > 0
        if path.suffix == ".png":
            assert imread(path).std() > 0.01


def test_same_results_give_the_same_files_and_declined_ones_leave_the_tables(results: Any, tmp_path: Path) -> None:
    few = type(results)(results.results[:1])
    one, other = (write_report(few, tmp_path / name) for name in "ab")
    for first, second in zip(one, other, strict=True):
        assert first.read_bytes() == second.read_bytes(), first.name
    declined = type(results)(tuple(r for r in results.results if r.localizer == "declined"))
    assert len(write_report(declined, tmp_path)) == 4


def test_a_report_of_the_same_results_is_not_drawn_again(
    results: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = dataclasses.replace(type(results)(results.results[:1]), kept=tmp_path)
    drawn: list[str] = []
    blank = ("Corridor-v0-cdf", Figure(figsize=(1.0, 1.0)))
    monkeypatch.setattr(folder_module, "_figures", lambda *given: drawn.append("drawn") or iter([blank]))
    monkeypatch.setattr(folder_module, "code_sha256", lambda env: "code")
    written = write_report(few, tmp_path)
    before = [path.stat().st_mtime_ns for path in written]
    assert write_report(few, tmp_path) == written
    assert [path.stat().st_mtime_ns for path in written] == before
    assert len(drawn) == 1
    written[-1].write_bytes(b"something else")  # whatever has changed is drawn
    write_report(few, tmp_path)
    write_report(few, tmp_path, FigureOptions(is_log=True))
    write_report(dataclasses.replace(few, results=results.results[1:2]), tmp_path)
    assert len(drawn) == 4


def test_pictures_mark_localizers_that_saw_the_whole_walk(
    results: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named: list[str] = []
    monkeypatch.setattr(
        "pdrbench.report.folder.draw_cdf", lambda ax, errors, styles, **_: named.extend(e.localizer for e in errors)
    )
    monkeypatch.setattr(folder_module, "_save", lambda *_, **__: [])
    revised = tuple(dataclasses.replace(r, division="offline") if r.localizer == "near" else r for r in results.results)
    write_report(type(results)(revised), tmp_path)
    assert named == ["near (offline)", "far", "broken"]


def test_errors_are_those_of_surveyed_positions_of_every_seed(part: SplitResults, corridor: SimpleNamespace) -> None:
    errors = errors_of(part, "near")
    assert tuple(errors.by_walk) == corridor.WALKS
    for i, walk in enumerate(corridor.WALKS):
        np.testing.assert_allclose(errors.by_walk[walk], np.full(2 * 19, 1.0 + i))


def test_a_panel_for_each_level_of_walk_and_estimates(corridor: SimpleNamespace) -> None:
    recording = corridor.recording("w")
    results = {"near": corridor.result("near", "w", 1.0)}
    assert levels_to_show(recording, results, (-5.0, -5.0, 25.0, 5.0)) == (0, 1)
    figure = draw_walk(recording, {"near": corridor.result("near", "w", 1.0)}, {"near": estimate_style(0)}, "title")
    assert [ax.get_title() for ax in figure.axes] == ["level 0", "level 1"]
    lower, upper = (
        {line.get_label(): np.isfinite(line.get_xdata()).sum() for line in ax.lines if line.get_label() == "near"}
        for ax in figure.axes
    )
    assert lower == upper == {"near": 10}


def test_estimates_far_away_do_not_widen_the_picture_and_are_counted(corridor: SimpleNamespace) -> None:
    far = corridor.result("far", "w", 5000.0)
    figure = draw_walk(corridor.recording("w"), {"far": far}, {"far": estimate_style(0)}, "title")
    assert figure.axes[0].get_ylim()[1] < 100
    assert "far 100 %" in figure.get_suptitle()


def test_options_reach_the_figures(results: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: dict[str, tuple[Any, str]] = {}
    save = folder_module._save

    def _save(figure: Any, stem: Path, options: Any, *, is_plan: bool) -> list[Path]:
        is_looked_at = stem.name.endswith(("-cdf", "-walk-1"))
        written = save(figure, stem, options, is_plan=is_plan) if is_looked_at else []
        drawn[stem.name] = figure, figure.get_suptitle()
        return written

    monkeypatch.setattr(folder_module, "_save", _save)
    options = FigureOptions((4.0, 3.0), ("svg",), {"near": "Ours"}, "A corridor", is_log=True, has_captions=True)
    written = {path.name for path in write_report(results, tmp_path, options)}
    assert written >= {"Corridor-v0-cdf.svg", "Corridor-v0-walk-1.svg", "captions.md"}
    assert not any(name.endswith((".png", ".pdf")) for name in written)
    figure, title = drawn["Corridor-v0-cdf"]
    assert title == "" and figure.axes[0].get_xscale() == "log" and tuple(figure.get_size_inches()) == (4.0, 3.0)
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels[0].startswith("Ours: median") and not any("near" in label or "declined" in label for label in labels)
    assert "Corridor-v0-cdf: A corridor; 6 walks; band: " in (tmp_path / "captions.md").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [({"formats": ("gif",)}, "no format of figures"), ({"labels": {"absent": "x"}}, "no localizer in these results"),
     ({"labels": {"near": "far"}}, "the same label")],
)  # fmt: skip
def test_figure_options_that_cannot_be_are_errors(
    results: Any, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(PdrbenchError, match=message):
        write_report(results, tmp_path, FigureOptions(**options))
