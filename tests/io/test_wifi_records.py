"""WiFi records of GetSensorData: the compiled parser reads what the pattern reads, and leaves the rest to it."""

from __future__ import annotations

import itertools

import numpy as np

from pdrbench_formats.recordings.getsensordata import _WIFI
from pdrbench_formats.recordings.log_kernels import parse_wifi

TIMES = ("1.5", "12,5", "1.5e0", "", "-1", "1.", "+1", "1.2.3", "1234567890.1234567")
NAMES = ("home", "a;b;c", "", "x;02:00:00:00:00:09;5", "02:00:00:00:00:09")
ADDRESSES = ("02:00:00:00:00:0A", "02-00-00-00-00-0b", " 02:00:00:00:00:0d", "02:00:00:00:00", "zz:00:00:00:00:01", "")
FREQUENCIES = ("2412;", "", "2412.5;", " 2412;", "-5;", "2412;;", ";")
STRENGTHS = ("-60", "-60.5", " -61", "-62;", "", "x", "60")


def test_a_record_that_is_read_is_read_as_the_pattern_reads_it() -> None:
    forms = itertools.product(TIMES, TIMES[:5], NAMES, ADDRESSES, FREQUENCIES, STRENGTHS)
    records = [
        f"WIFI;{app};{sensor};{name};{at};{rest}{dbm}".encode().rstrip() for app, sensor, name, at, rest, dbm in forms
    ]
    ends = np.cumsum([len(record) + 1 for record in records])
    begins = ends - [len(record) + 1 for record in records]
    bounds = np.column_stack([begins, ends - 1, np.arange(len(records))])
    numbers, address = np.empty((len(records), 4)), np.empty(len(records), np.int64)
    parse_wifi(np.frombuffer(b"\n".join(records) + b"\n", np.uint8), bounds, numbers, address)
    read = np.flatnonzero(address >= 0)
    assert len(read) > 100
    for row in read.tolist():
        match = _WIFI.match(records[row])
        assert match is not None, records[row]
        app, sensor, name, frequency, dbm = match.groups(b"")
        wanted = [float(app), float(sensor or b"nan"), float(frequency or b"0"), float(dbm)]
        np.testing.assert_array_equal(numbers[row], wanted, str(records[row]))
        assert address[row] == int(name.replace(b":", b""), 16)
    plain = [row for row, record in enumerate(records) if record == b"WIFI;1.5;1.5;home;02:00:00:00:00:0A;2412;-60"]
    assert address[plain[0]] == 0x02000000000A  # the usual form is not left to the pattern
