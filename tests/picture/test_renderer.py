"""Frames: always the same size, cheap after the first, with the given content."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import PdrbenchError
from pdrbench.localizer import Estimate
from pdrbench.picture import Renderer, Window

TRAIL_M = np.column_stack([np.linspace(1.0, 11.0, 50), np.full(50, 1.6)])


def differ(one: np.ndarray, other: np.ndarray) -> int:
    return int((one != other).any(axis=2).sum())


@pytest.mark.parametrize("with_map", [True, False])
def test_same_shape_for_every_level_and_place(building: Building, with_map: bool) -> None:
    renderer = Renderer(building if with_map else None)
    frames = [
        renderer.frame(0, np.zeros((0, 2)), None),
        renderer.frame(1, TRAIL_M, Estimate(TRAIL_M[-1], 1), now_s=3.0),
        renderer.frame(5, TRAIL_M * 40, Estimate(TRAIL_M[-1] * 40, 5)),
    ]
    assert len({frame.shape for frame in frames}) == 1
    assert all(frame.dtype == np.uint8 and frame.flags.c_contiguous for frame in frames)
    assert frames[0].shape[0] % 2 == frames[0].shape[1] % 2 == 0


@pytest.mark.parametrize("size_m", [(60.0, 8.0), (60.0, 28.0), (8.0, 60.0), (250.0, 300.0), (30.0, 20.0)])
def test_labels_of_axes_and_title_are_not_cut_off(size_m: tuple[float, float]) -> None:
    width_m, height_m = size_m
    outline = np.array([[-width_m, -height_m], [0.0, -height_m], [0.0, 0.0], [-width_m, 0.0]])  # long tick labels
    hall = Building("hall", (FloorPolygon("hall", outline, np.full(4, WALL), height_m=0.0, level=0),))
    frame = Renderer(hall).frame(0, np.zeros((0, 2)), None, now_s=1234.5)
    for edge in (frame[:3], frame[-3:], frame[:, :3], frame[:, -3:]):
        assert (edge == 255).all()


def test_a_frame_keeps_nothing_of_the_frame_before(building: Building) -> None:
    renderer = Renderer(building)
    first = renderer.frame(0, np.zeros((0, 2)), None)
    estimate = Estimate(TRAIL_M[-1], 0, heading_rad=0.4, sigma_m=1.0)
    full = renderer.frame(0, TRAIL_M, estimate, TRAIL_M + 0.2, np.zeros(50), 7.0)
    assert differ(first, full) > 500
    np.testing.assert_array_equal(renderer.frame(0, np.zeros((0, 2)), None), first)
    np.testing.assert_array_equal(full, renderer.frame(0, TRAIL_M, estimate, TRAIL_M + 0.2, np.zeros(50), 7.0))


def test_other_levels_are_left_out(building: Building) -> None:
    renderer = Renderer(building)
    empty = renderer.frame(0, np.zeros((0, 2)), None)
    above = np.ones(50)
    np.testing.assert_array_equal(renderer.frame(0, TRAIL_M, None, trail_level=above), empty)
    np.testing.assert_array_equal(renderer.frame(0, TRAIL_M[:0], None, TRAIL_M, above), empty)
    assert differ(renderer.frame(0, TRAIL_M, None, trail_level=above * 0), empty) > 50


@pytest.mark.parametrize("sigma_m", [float("nan"), float("inf"), 0.0, -1.0])
@pytest.mark.parametrize("with_map", [True, False])
def test_estimates_that_make_no_sense_are_not_drawn(building: Building, with_map: bool, sigma_m: float) -> None:
    renderer = Renderer(building if with_map else None)
    plain = renderer.frame(0, np.zeros((0, 2)), None)
    nowhere = Estimate(np.array([np.nan, 1.0]), 0, heading_rad=0.0, sigma_m=sigma_m)
    np.testing.assert_array_equal(renderer.frame(0, np.full((3, 2), np.nan), nowhere), plain)


def test_without_a_map_the_walk_stays_in_the_picture() -> None:
    renderer = Renderer(None)
    far_m = np.array([[100.0, -40.0], [100.0, 5000.0]])
    frame = renderer.frame(0, far_m, Estimate(far_m[-1], 0))
    blueish = (frame[:, :, 2] > 140) & (frame[:, :, 0] < 60)
    assert blueish.any()


def test_without_a_display_or_toolkit_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(PdrbenchError, match="rgb_array"):
        Window()
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("pdrbench.picture.window.TOOLKITS", {"pdrbench_no_such_module": "a toolkit"})
    with pytest.raises(PdrbenchError, match="install one, or use render_mode='rgb_array'"):
        Window()
