"""What a localizer asks of its briefing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Carrier
from pdrbench.sensors import sensor_spec

SENSORS = {"accel": replace(sensor_spec("accel"), rate_hz=50.0), "gyro": replace(sensor_spec("gyro"), rate_hz=None)}


@pytest.mark.parametrize(
    ("mounting", "carrier", "why"),
    [
        ("hand", "foot", "is carried in the hand"),
        ("", "foot", "may be carried anywhere"),
        ("foot", "phone", "needs a phone"),
    ],
)
def test_a_device_carried_elsewhere_is_declined(mounting: str, carrier: Carrier, why: str) -> None:
    briefing = Briefing(None, SENSORS, 0.2, mounting=mounting)
    with pytest.raises(UnsuitableError, match=why):
        briefing.require(carrier=carrier)
    briefing.require(carrier=briefing.carrier)


def test_a_slow_sensor_is_declined_where_its_rate_is_known() -> None:
    briefing = Briefing(None, SENSORS, 0.2)
    briefing.require(sensors=("accel", "gyro"), min_rate_hz=50.0)
    with pytest.raises(UnsuitableError, match=r"'accel' at 80 Hz or more; this one has 50 Hz"):
        briefing.require(sensors=("gyro", "accel"), min_rate_hz=80.0)
