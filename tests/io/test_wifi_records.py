"""WiFi records of GetSensorData: names hold separators, fields are missing."""

from __future__ import annotations

import math

import pytest

from pdrbench_formats.recordings.getsensordata import _parse_wifi

ADDRESS = "02:00:00:00:00:0A"


@pytest.mark.parametrize("name", ["home", "a;b;c", "", "x;02:00:00:00:00:09;5", "02:00:00:00:00:09"])
@pytest.mark.parametrize(("frequency", "mhz"), [("2412;", 2412.0), ("", 0.0)])
@pytest.mark.parametrize(("seen", "seen_s"), [("12,5", 12.5), ("", math.nan)])
def test_the_last_fields_count_from_the_right(name: str, frequency: str, mhz: float, seen: str, seen_s: float) -> None:
    *numbers, address = _parse_wifi(f"WIFI;1.5;{seen};{name};{ADDRESS};{frequency}-60;".encode())
    assert numbers == pytest.approx([1.5, seen_s, mhz, -60.0], nan_ok=True)
    assert address == ADDRESS.encode()


@pytest.mark.parametrize("rest", ["home;zz:00:00:00:00:01;-60", "home;02:00:00:00:00;-60", f"a;{ADDRESS};x", ""])
def test_what_has_no_address_or_strength_is_refused(rest: str) -> None:
    with pytest.raises(ValueError, match="no address"):
        _parse_wifi(f"WIFI;1.5;1.2;{rest}".encode())
