"""The file of errors of strides: read as written, and refused with its field where it is another one."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import ResultError
from pdrbench.recording import SensorStream
from pdrbench.sensors.stride import STRIDE
from pdrbench_lab.stride_errors.error_file import MEASURED, ErrorSizes, read_error_file, read_errors
from pdrbench_sim.units.strides import StrideErrors, measure


def test_the_packaged_file_has_the_fields_of_the_class():
    assert [field.name for field in dataclasses.fields(StrideErrors)] == list(ErrorSizes.__struct_fields__)
    errors = read_errors()
    assert errors.length_bias == read_error_file().errors.length_bias
    assert -0.03 < errors.length_bias < -0.01
    straight = np.column_stack([np.arange(1.0, 101.0), np.full(100, 1.3), np.zeros((100, 2))])
    rows = measure(straight, np.random.default_rng(5), errors)
    SensorStream(STRIDE, rows)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"errors": {"length_bias": 0.0}}, "length_sigma_m"),
        ({"colour": "red"}, "colour"),
        ({"format": 2}, "format 2, expected 1"),
        ({"pdrbench": 1}, "pdrbench"),
    ],
)
def test_another_file_is_refused_with_its_field_and_a_remedy(tmp_path: Path, change: dict[str, object], why: str):
    file = tmp_path / "errors.json"
    file.write_text(json.dumps(json.loads(MEASURED.read_text("utf-8")) | change), encoding="utf-8")
    with pytest.raises(ResultError, match=rf"errors\.json: .*{why}.*pdrbench error-model --out"):
        read_errors(file)


def test_negative_sigmas_unknown_sizes_and_torn_files_are_refused(tmp_path: Path):
    known = json.loads(MEASURED.read_text("utf-8"))
    file = tmp_path / "errors.json"
    for sizes in ({"length_sigma_m": -0.1}, {"sway_m": 0.1}):
        file.write_text(json.dumps(known | {"errors": known["errors"] | sizes}), encoding="utf-8")
        with pytest.raises(ResultError, match=r"errors\.json.*\$\.errors|errors\.json.*sway_m"):
            read_errors(file)
    file.write_text(json.dumps(known | {"errors": known["errors"] | {"height_sigma_m": None}}), encoding="utf-8")
    with pytest.raises(ResultError, match=r"errors\.json: height_sigma_m was not measured; measure on every"):
        read_errors(file)
    file.write_bytes(MEASURED.read_bytes()[:100])
    with pytest.raises(ResultError, match="not a file of stride errors"):
        read_errors(file)
    with pytest.raises(ResultError, match="cannot be read"):
        read_errors(tmp_path / "none.json")


def test_the_file_is_written_as_it_was_read():
    assert read_error_file().encode() == MEASURED.read_text("utf-8")
