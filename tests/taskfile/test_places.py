"""Tables of places and of surveys as other programs write them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.io.geo import GeoFrame
from pdrbench_formats.taskfile.places import check_not_exchanged, read_places
from pdrbench_formats.taskfile.survey import is_survey_table, read_survey_table

ISO = "2023-11-14T22:13:{:02d}.000Z"


@pytest.mark.parametrize(
    "text",
    [
        "t_s;x_m;y_m;level\n0,00;1,5;2,25;0\n1,00;;;\n2,00;3,0;4,5;0\n",
        "# timestamp tx ty tz qx qy qz qw\n0.0 1.5 2.25 0 0 0 0 1\n2.0 3.0 4.5 0 0 0 0 1\n",
        "0.0 1.5 2.25 0 0 0 0 1\n2.0 3.0 4.5 0 0 0 0 1\n",
        f"time,X,Y,floor\n{ISO.format(20)},1.5,2.25,0\n{ISO.format(22)},3.0,4.5,0\n",
        "time_ms\tx (m)\ty (m)\n0\t1.5\t2.25\n2000\t3.0\t4.5\n",
        "timestamp,x [cm],y [cm]\n1700000000000,150,225\n1700000002000,300,450\n",
        "Höhe,t_s,x_m,y_m\n0,0,1.5,2.25\n0,2,3.0,4.5\n",
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m]\n1700000000000000000,1.5,2.25\n1700000002000000000,3.0,4.5\n",
        "0.0 1.5 2.25\n2.0 3.0 4.5\n",
        "1700000000.0 1.5 2.25 0 0 0 0 1\n1700000002.0 3.0 4.5 0 0 0 0 1\n",
        "0.0,1.5,2.25,0,0,0,0,1\n2.0,3.0,4.5,0,0,0,0,1\n",
        "time,x,y\n0:00.0,1.5,2.25\n0:02.0,3.0,4.5\n",
        "t;E [m];N [m];floor\n0;1,5;2,25;\n2;3,0;4,5;\n",
        "time_ms,x_cm,y_cm,level\n0,150,225,0\n2000,300,450,0\n",
        "Zeit (s)\tX (m)\tY (m)\tEtage\n0,00\t1,5\t2,25\t1\n2,00\t3,0\t4,5\t2\n",
    ],
)
def test_truth_in_the_dialects_of_recordings(text: str, tmp_path: Path) -> None:
    (tmp_path / "truth.txt").write_bytes(text.encode("cp1252"))
    reference, geo, left_out = read_places(tmp_path / "truth.txt", 1_700_000_000.0)
    assert geo is None and ("1 without a place" in left_out) == (";;" in text)
    np.testing.assert_allclose(reference.t_s, [0.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(reference.xy_m, [[1.5, 2.25], [3.0, 4.5]], atol=1e-9)
    assert reference.level.tolist() == ([1, 2] if "Etage" in text else [0, 0])


def test_surveys_of_other_programs(tmp_path: Path) -> None:
    """The log of the Anyplace Logger, and rows of scans with a column for each access point."""
    path = tmp_path / "scans.txt"
    rows = [
        f"1476000000, 48.0000{k}, 11.0000{k}, 120.0, 02:00:00:00:00:0{j}, -{50 + j}, 1" for k in (1, 5) for j in (1, 2)
    ]
    path.write_text("\n".join(["# Timestamp, X, Y, HEADING, MAC Address of AP, RSS, Floor", *rows, ""]))
    assert is_survey_table(path)
    scans, geo = read_survey_table(path)
    assert geo is not None and scans.count.tolist() == [2, 2] and scans.level.tolist() == [1, 1]
    assert np.hypot(*np.diff(scans.xy_m, axis=0)[0]) == pytest.approx(5.34, abs=0.1)
    path.write_text(
        "WAP001,WAP002,WAP003,LONGITUDE,LATITUDE,FLOOR\n100,-97,-60,-7541.2,4864920.7,2\n-50,100,100,-7536.6,4864934.2,2\n"
    )
    scans, geo = read_survey_table(path)
    assert geo is None and scans.count.tolist() == [2, 1] and scans.readings[:, 1].tolist() == [-97.0, -60.0, -50.0]
    assert scans.xy_m.tolist() == [[-7541.2, 4864920.7], [-7536.6, 4864934.2]]


MACS = ("02:00:00:00:00:01", "02:00:00:00:00:02", "02:00:00:00:00:03")


@pytest.mark.parametrize(
    "text",
    [
        f"x,y,floor,SSID,BSSID,level\n1,2,3,my net,{MACS[0]},-50\n1,2,3,my net,{MACS[1]},-60\n",
        "MAC1,MAC2,MAC3,ECoord,NCoord,FloorID\n-50,100,-60,1,2,3\n",
        f"# NaN -110\n# X, Y, floor, {', '.join(MACS)}\n1, 2, 3, -50, -110, -60\n1, 2, 3, -110, -110, -110\n",
        "x,y,floor,b3001,b3002,b3003\n1,2,3,-50,-200,-60\n",
        "X;Y;Etage;MAC;RSSI (dBm)\n1,0;2,0;3;AP 1;-50,0\n1,0;2,0;3;AP 2;-60,0\n",
    ],
)
def test_surveys_in_the_dialects_of_loggers(text: str, tmp_path: Path) -> None:
    (tmp_path / "scans.csv").write_text(text)
    assert is_survey_table(tmp_path / "scans.csv")
    scans, geo = read_survey_table(tmp_path / "scans.csv")
    assert geo is None and scans.xy_m.tolist() == [[1.0, 2.0]] and scans.level.tolist() == [3]
    assert scans.readings[:, 1].tolist() == [-50.0, -60.0]


def test_degrees_exchanged_in_one_of_two_sources_name_both() -> None:
    with pytest.raises(RecordingError, match=r"11.10, longitude 49.50, and the other places at 49.46, 11.11: exchange"):
        check_not_exchanged(GeoFrame(11.1, 49.5), GeoFrame(49.46, 11.11), "the places")


PLACES = ((0.0, 3.0, 4.5, 0), (10.0, 9.0, 4.5, 0), (21.0, 9.0, 12.0, 1))
IN_JSON = [{"time": t, "position": {"x": x, "y": y, "floor": level}} for t, x, y, level in PLACES]


@pytest.mark.parametrize(
    "text",
    [
        "t_s,x (in),y (in),floor\n" + "".join(f"{t},{x / 0.0254},{y / 0.0254},{f}OG\n" for t, x, y, f in PLACES),
        "Zeit [min];X [mm];Y [mm];Etage\n0;3.000,0;4.500,0;EG\n0,166666667;9.000,0;4.500,0;EG\n"
        "0,35;9.000,0;12.000,0;1.OG\n0,35;9.000,0;12.000,0;1.OG\n",
        "t,pose.position.x,pose.position.y,階\n" + "".join(f"{t},{x},{y},{f}\n" for t, x, y, f in PLACES),
        json.dumps({"waypoints": IN_JSON}),
    ],
)
def test_places_of_strangers(text: str, tmp_path: Path) -> None:
    text = text.replace("0OG", "EG")
    (tmp_path / "a.csv").write_bytes(text.encode("shift_jis"))
    places, _, _ = read_places(tmp_path / "a.csv", None)
    found = np.column_stack([places.t_s, places.xy_m, places.level])
    np.testing.assert_allclose(found, PLACES, atol=1e-3)


@pytest.mark.parametrize(("names", "message"), [("x (px),y (px)", "none of m, cm"), ("lat,lon", "exchange the names")])
def test_places_that_would_be_wrong(names: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"t_s,{names}\n0,111.5,48.1\n9,111.6,48.2\n", encoding="utf-8")
    with pytest.raises(RecordingError, match=message):
        read_places(tmp_path / "a.csv", None)


def test_surveys_of_strangers(tmp_path: Path) -> None:
    """Addresses in two ways of writing, what was not received as -110, and scans in JSON are one survey."""
    macs = ("02:00:00:00:00:0a", "02:00:00:00:00:0b", "02:00:00:00:00:0c")
    scans = [(x, 2.5, 0, *((-50 - x, -60, None) if x % 2 else (-55, None, -70))) for x in range(6)]
    wide = ["x,y,level," + ",".join(mac.upper().replace(":", "-") for mac in macs)]
    wide += [",".join("-110" if value is None else str(value) for value in row) for row in scans]
    (tmp_path / "a.csv").write_text("\n".join(wide), encoding="utf-8")
    given = [
        {"x": x, "y": y, "floor": f, "wifi": [{"mac": m, "rss": r} for m, r in zip(macs, of, strict=True) if r]}
        for x, y, f, *of in scans
    ]
    (tmp_path / "a.json").write_text(json.dumps(given), encoding="utf-8")
    found = [read_survey_table(tmp_path / name)[0] for name in ("a.csv", "a.json")]
    assert np.array_equal(found[0].readings, found[1].readings) and len(found[0].readings) == 12
    assert np.array_equal(found[0].xy_m, found[1].xy_m)
