"""Messages between the evaluating process and a localizer's: nothing lost, nothing taken that is no reply."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from pdrbench.episode import Claims
from pdrbench.isolation import messages
from pdrbench.isolation.messages import Array, ProtocolError, frame, frame_size, read_reply, read_request
from pdrbench.isolation.telling import (
    pack_briefing,
    pack_generator,
    pack_reference,
    unpack_briefing,
    unpack_generator,
    unpack_reference,
)
from pdrbench.registry import make_task

CLAIMS = Claims(1.0, 2.0, 0.0, 0.5, 0.1, 1.0)
ANSWERS: Any = (messages.Answer, messages.Missing)


def body(message: msgspec.Struct) -> bytes:
    return frame(message)[messages.LENGTH_BYTES :]


@pytest.mark.parametrize("env", ["OfficePhone-v0", "WlanHallway-v0", "BuildingSite-v0"])
def test_a_briefing_arrives_as_it_was_sent(env: str) -> None:
    """With a building and a radio map, with a radio map alone, and with a building and no heading."""
    task = make_task(env)
    sent = task.brief(task.load(task.split("train")[0]))
    message = read_request(body(messages.Reset(1, pack_briefing(sent), pack_generator(np.random.default_rng(0)))))
    assert isinstance(message, messages.Reset)
    came = unpack_briefing(message.briefing)
    assert came.building == sent.building
    assert [*came.sensors] == [*sent.sensors]
    for name, spec in sent.sensors.items():
        assert (came.sensors[name].columns, came.sensors[name].rate_hz) == (spec.columns, spec.rate_hz)
        assert came.sensors[name].low.tobytes() == spec.low.tobytes()
    assert (came.period_s, dict(came.subject), came.mounting) == (sent.period_s, dict(sent.subject), sent.mounting)
    assert (came.start is None) == (sent.start is None)
    if sent.start is not None and came.start is not None:
        assert came.start.xy_m.tobytes() == sent.start.xy_m.tobytes()
        assert (came.start.level, came.start.heading_rad) == (sent.start.level, sent.start.heading_rad)
    assert (came.radio_map is None) == (sent.radio_map is None)
    if sent.radio_map is not None and came.radio_map is not None:
        for column in ("xy_m", "level", "walk", "first", "access_point", "rssi_dbm", "age_s"):
            assert getattr(came.radio_map, column).tobytes() == getattr(sent.radio_map, column).tobytes(), column


def test_a_reference_arrives_as_it_was_sent() -> None:
    task = make_task("OfficeStride-v0")
    sent = task.load(task.split("train")[0]).reference
    came = unpack_reference(pack_reference(sent))
    for column in ("t_s", "xy_m", "level", "surveyed"):
        assert getattr(came, column).tobytes() == getattr(sent, column).tobytes()


def test_a_generator_goes_on_where_it_was_and_has_the_same_children() -> None:
    rng = np.random.default_rng([3, 141592653589793, 1])
    rng.random(5)
    rng.spawn(2)
    came = unpack_generator(read_request_rng(rng))
    assert came.spawn(1)[0].random(3).tolist() == rng.spawn(1)[0].random(3).tolist()
    assert came.random(7).tolist() == rng.random(7).tolist()
    assert came.integers(0, 2**31, 3).tolist() == rng.integers(0, 2**31, 3).tolist()


def read_request_rng(rng: np.random.Generator) -> messages.Dice:
    sent = messages.Told(None, [], 1.0, None, None, {}, "")
    request = read_request(body(messages.Reset(1, sent, pack_generator(rng))))
    assert isinstance(request, messages.Reset)
    return request.rng


def test_an_array_that_arrived_can_be_written_to() -> None:
    came = Array.of(np.arange(6.0).reshape(2, 3)).array()
    came[0, 0] = 7.0
    assert came.shape == (2, 3)


def test_replies_are_taken_for_the_request_they_answer() -> None:
    reply = read_reply(body(messages.Answer(3, CLAIMS)), 3, ANSWERS)
    assert isinstance(reply, messages.Answer)
    assert reply.claims == CLAIMS
    assert isinstance(reply.claims, Claims)
    assert isinstance(read_reply(body(messages.Failed(3, False, "oh")), 3, ANSWERS), messages.Failed)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00",
        b"garbage",
        b"\x91" * 100_000,  # arrays in arrays in arrays
        b"\x81" * 100_000,
        b"\xdd\xff\xff\xff\xff",  # an array of four billion
        b"\xc6\xff\xff\xff\xff",  # bytes that never come
        body(messages.Answer(2, CLAIMS)),  # another request
        body(messages.Answer(3, CLAIMS)) + b"\x00",  # one byte more
        msgspec.msgpack.encode(["answer", 3, CLAIMS[:5]]),
        msgspec.msgpack.encode(["answer", 3, [*CLAIMS, 0.0]]),
        msgspec.msgpack.encode(["answer", 3, [*CLAIMS[:5], "1"]]),
        msgspec.msgpack.encode(["answer", 3, [*CLAIMS[:5], None]]),
        body(messages.Done(3)),  # another kind
        body(messages.Ready(3, True, True, [])),
        body(messages.Step(3, 0.0, [])),  # a request
        msgspec.msgpack.encode(["answer", 3, CLAIMS, "more"]),
        msgspec.msgpack.encode(["answer", 3.5, CLAIMS]),
        msgspec.msgpack.encode(["answer", "3", CLAIMS]),
        msgspec.msgpack.encode(["missing", 3, "mood"]),
        msgspec.msgpack.encode(["nonsense", 3]),
        msgspec.msgpack.encode({"answer": 3}),
        b"\x93\xa6failed\x03\xc2\xa1\xff",  # text that is no UTF-8
    ],
)
def test_what_is_no_reply_is_refused(content: bytes) -> None:
    with pytest.raises(ProtocolError):
        read_reply(content, 3, ANSWERS)


@pytest.mark.parametrize(
    "rows",
    [
        Array("<f8", (2, 6), bytes(95)),
        Array("<f8", (-1, 6), b""),
        Array("<f8", (2**62, 2**62), b""),
        Array("<i8", (1 << 40,), bytes(8)),
    ],
)
def test_a_revised_past_whose_shape_is_not_its_size_is_refused(rows: Array) -> None:
    with pytest.raises(ProtocolError, match="array of shape"):
        read_reply(body(messages.Track(1, rows)), 1, messages.Track)


def test_a_frame_is_refused_by_its_length_before_it_has_come() -> None:
    assert frame_size(b"\x00\x00\x01", 64) is None
    assert frame_size(b"\x40\x00\x00\x00", 64) == 68
    with pytest.raises(ProtocolError, match="1073741824 bytes"):
        frame_size((1 << 30).to_bytes(4, "little"), 64)
