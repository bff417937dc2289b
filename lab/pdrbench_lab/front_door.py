"""`pdrbench try` on folders as strangers have them: whom it says to believe, how far that errs, how long it takes.

python -m pdrbench_lab.front_door [FOLDER]    writes the folders there, and a row for each to stdout

One simulated walk of 90 s in an office, written as twelve people would bring it, whose true path is known. Right is an
answer that errs by at most 1.25 times the least of those that `try` played, on all of the true path; where nothing is
known of the frame, once turned onto it. Where nothing can be believed, right is to name none.
"""

from __future__ import annotations

import io
import json
import resource
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.cli.output import say
from pdrbench.geometry import FloatArray
from pdrbench.metrics.odometry import align_se2
from pdrbench.recording import Recording
from pdrbench_formats.maps.geojson import write
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.record import IN_HAND, IN_POCKET, ON_FOOT, make_scene, simulate_walk

START: Final = datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)
NAMES: Final = {"accel": "Accelerometer", "gyro": "Gyroscope", "mag": "Magnetometer"}
UNITS: Final = {"accel": "m/s^2", "gyro": "rad/s", "mag": "uT"}
NUM_PLACES: Final = 11
NEAR: Final = 1.25  # times the least error: what chance makes of two localizers
Files = dict[str, bytes]


def table(header: str, rows: FloatArray, separator: str = ",", *, comma: bool = False) -> bytes:
    """A table as text."""
    lines = [separator.join(f"{value:.6f}" for value in row) for row in rows]
    text = "\n".join([header, *(line.replace(".", ",") if comma else line for line in lines), ""])
    return text.encode()


def sensors(walk: Recording, *, comma: bool = False, drop: tuple[str, ...] = ()) -> Files:
    """A table for each sensor, as phyphox and others export them."""
    mark = ";" if comma else ","
    return {
        f"{NAMES[name]}.csv": table(
            mark.join(["time (s)", *(f"{axis} ({unit})" for axis in "xyz")]), walk.streams[name].rows, mark, comma=comma
        )
        for name, unit in UNITS.items()
        if name in walk.streams and name not in drop
    }


def one_table(walk: Recording, rate_hz: float = 100.0) -> tuple[FloatArray, FloatArray]:
    """(N,) times and (N, 6) accelerations in g and rates in degrees/s, on one clock."""
    t_s = np.arange(0.0, walk.streams["accel"].t_s[-1], 1.0 / rate_hz)
    at = {name: walk.streams[name].rows for name in ("accel", "gyro")}
    columns = [np.interp(t_s, at[name][:, 0], axis) for name in at for axis in at[name][:, 1:].T]
    return t_s, np.column_stack(columns) * np.repeat([1 / 9.80665, 180 / np.pi], 3)


def places(walk: Recording) -> FloatArray:
    """(K, 4) time, x, y and level on the way."""
    at = np.linspace(0, len(walk.reference.t_s) - 1, NUM_PLACES).astype(int)
    true = walk.reference
    return np.column_stack([true.t_s[at], true.xy_m[at], true.level[at]])


def zipped(files: Files) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, part in files.items():
            archive.writestr(name, part)
    return content.getvalue()


def folders(walk: Recording, pocket: Recording, foot: Recording, plan: bytes) -> Iterator[tuple[str, Files, list[str]]]:
    """What it is, files, and the arguments of `try`; the first file is the recording."""
    true, header = places(walk), "t_s,x_m,y_m,level"
    first = ["--start", f"{true[0, 1]:.2f},{true[0, 2]:.2f},0"]
    late = true.copy()
    late[:, 0] += 3.0
    t_s, columns = one_table(walk)
    stamps = [(START + timedelta(seconds=float(t))).strftime("%m/%d/%Y %I:%M:%S.%f %p") for t in t_s]
    names = "AX,AY,AZ,GX,GY,GZ"
    rows = [f"{stamp},{','.join(f'{value:.5f}' for value in row)}" for stamp, row in zip(stamps, columns, strict=True)]
    clock = "\n".join([f"Time,{names}", *rows, ""]).encode()
    objects = [
        {"t": t, "acc": list(row[:3]), "gyro": list(row[3:])}
        for t, row in zip(t_s.tolist(), columns.tolist(), strict=True)
    ]
    feet = json.loads(plan)
    spots = [dict(zip(("time", "x", "y", "floor"), row, strict=True)) for row in true.tolist()]
    all_of = ["--map", "plan.geojson", "--truth", "places.csv", "--heading", "HEADING", "--mounting", "hand"]
    places_csv, drawn = table(header, true), {"plan.geojson": plan}
    yield "zip, plan, places, heading", {"a.zip": zipped(sensors(walk)), "places.csv": places_csv, **drawn}, all_of
    excel = table("Zeit [s];X [cm];Y [cm];Etage", true * [1, 100, 100, 1], ";", comma=True)
    german = zipped(sensors(walk, comma=True))
    yield "semicolons, decimal commas, places in cm", {"a.zip": german, "places.csv": excel, **drawn}, all_of
    yield "12-hour clock, g, deg/s, no magnetometer", {"a.csv": clock, "places.csv": places_csv, **drawn}, all_of
    gbk = table("时间,x,y,楼层", true).decode().encode("gb18030")
    yield "JSON rows, places in GBK", {"a.json": json.dumps(objects).encode(), "places.csv": gbk, **drawn}, all_of
    listed = json.dumps({"waypoints": spots}).encode()
    with_json = [word.replace("places.csv", "places.json") for word in all_of]
    yield "places in JSON", {"a.zip": zipped(sensors(walk)), "places.json": listed, **drawn}, with_json
    no_heading = ["--map", "plan.geojson", "--truth", "places.csv"]
    yield "no heading", {"a.zip": zipped(sensors(walk)), "places.csv": places_csv, **drawn}, no_heading
    given = ["--map", "plan.geojson", *first, "--heading", "HEADING"]
    yield "start and heading, no places", {"a.zip": zipped(sensors(walk)), **drawn}, given
    yield "a recording alone", {"a.zip": zipped(sensors(walk))}, []
    yield (
        "phone in a pocket, no plan",
        {"a.zip": zipped(sensors(pocket)), "places.csv": table(header, places(pocket))},
        ["--truth", "places.csv", "--mounting", "pocket"],
    )
    shoe = {"a.zip": zipped(sensors(foot)), "places.csv": table(header, places(foot))}
    yield "a shoe, no plan", shoe, ["--truth", "places.csv"]
    yield "places 3 s late", {"a.zip": zipped(sensors(walk)), "places.csv": table(header, late), **drawn}, all_of
    for one in feet["features"]:
        one["properties"].pop("height_m", None)
    still = {
        f"{NAMES[name]}.csv": table(
            f"time (s),{','.join(f'{a} ({UNITS[name]})' for a in 'xyz')}", still_rows(walk, name)
        )
        for name in UNITS
    }
    yield "a phone that lay still", {"a.zip": zipped(still), **drawn}, given


def still_rows(walk: Recording, name: str) -> FloatArray:
    """The first row of a sensor again and again, with its noise."""
    rows = walk.streams[name].rows.copy()
    value = {"accel": [0.05, 0.1, 9.8], "gyro": [0.0, 0.0, 0.0]}.get(name, rows[0, 1:])
    rows[:, 1:] = np.asarray(value) + 0.01 * np.random.default_rng(1).standard_normal((len(rows), 3))
    return rows


def true_errors(folder: Path, walk: Recording, is_turned: bool) -> dict[str, float]:
    """Mean error of each path that was written, in metres, on the true path."""
    found = {}
    for file in sorted((folder / "out" / "paths").glob("*/*.csv")):
        if file.stem == "reference":
            continue
        rows = np.genfromtxt(file, delimiter=",", names=True)
        t_s, xy_m = rows["t_s"], np.column_stack([rows["x_m"], rows["y_m"]])
        at = np.column_stack([np.interp(walk.reference.t_s, t_s, axis) for axis in xy_m.T])
        at = align_se2(at, walk.reference.xy_m).xy_m if is_turned else at
        found[file.stem] = float(np.linalg.norm(at - walk.reference.xy_m, axis=1).mean())
    return found


def run(folder: Path, files: Mapping[str, bytes], arguments: list[str]) -> tuple[str, float]:
    """The first line of `try`, and the seconds of processor that it took."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    command = [str(Path(sys.executable).with_name("pdrbench")), "try", next(iter(files)), *arguments, "--out", "out"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return (done.stdout.strip() or done.stderr.strip() or "nothing").splitlines()[0], spent_s


def simulated() -> tuple[dict[str, Recording], bytes, Callable[[str], float]]:
    """Walks with a phone in the hand, in a pocket and a shoe, and the plan of their building."""
    building = make_office(np.random.default_rng(1), num_levels=1, area_m2=1500)
    scene = make_scene(np.random.default_rng(2), building)
    walks = {
        name: simulate_walk(scene, 3, setup, duration_s=90)
        for name, setup in (("hand", IN_HAND), ("pocket", IN_POCKET), ("foot", ON_FOOT))
    }
    path = Path("plan.geojson")
    write(building, path)
    plan = path.read_bytes()
    path.unlink()

    def heading(name: str) -> float:
        true = walks[name].reference
        begin = true.heading_rad
        return float(np.degrees(begin[0])) if begin is not None else 0.0

    return walks, plan, heading


def main() -> None:
    root = Path(sys.argv[1] if len(sys.argv) > 1 else "front-door")
    walks, plan, heading = simulated()
    say("| folder | first line | its true error, m | least of those played | processor, s | right |")
    say("|---|---|---|---|---|---|")
    for number, (what, files, arguments) in enumerate(folders(walks["hand"], walks["pocket"], walks["foot"], plan)):
        words = [word.replace("HEADING", f"{heading('hand'):.0f}") for word in arguments]
        line, spent_s = run(root / f"{number:02d}", files, words)
        walk = walks["pocket" if "pocket" in what else "foot" if "shoe" in what else "hand"]
        errors = true_errors(root / f"{number:02d}", walk, "--heading" not in words)
        named = line.removeprefix("believe ").partition(":")[0]
        own = errors.get(named.replace(" (offline)", "-offline"), float("nan"))
        least = min(errors.values(), default=float("nan"))
        right = named.startswith("no localizer") if "still" in what else own <= NEAR * least
        say(f"| {what} | {line} | {own:.2f} | {least:.2f} | {spent_s:.1f} | {'yes' if right else 'no'} |")


if __name__ == "__main__":
    main()
