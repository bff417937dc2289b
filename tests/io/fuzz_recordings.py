"""Coverage-guided fuzzing of one reader of recordings: nothing but the project's own errors may come out.

    python tests/io/fuzz_recordings.py --list
    python tests/io/fuzz_recordings.py READER SECONDS [--keep FILE] [--corpus FOLDER]
    python tests/io/fuzz_recordings.py READER --replay FILE

READER is a key of `pdrbench_formats.READERS`. Exit status 1, and the input in FILE, where a reader raises anything else
than `RecordingError`, returns rows that are not finite or not in order of time, takes more than ten seconds, or more
than a gigabyte. `--replay` reads such an input again and says where it wrote it as a file. Needs atheris.

An input is the name of a packing and parts, each with a name and a content. Archives, HDF5 files, databases and bags
are packed from their parts, so that changes reach what is inside them; as packing `raw`, the packed bytes themselves
are changed. Seeds are the walk of `pdrbench_formats.samples` in each format, and the real samples where they are found.
"""

from __future__ import annotations

import os
import tempfile

# kernels check their bounds here, and are compiled into a cache of their own
os.environ["NUMBA_BOUNDSCHECK"] = "1"
os.environ["NUMBA_CACHE_DIR"] = os.path.join(tempfile.gettempdir(), "pdrbench-fuzz-kernels")  # noqa: PTH118

import argparse
import importlib.util
import random  # noqa: TID251  # libFuzzer gives seeds of mutations
import re
import resource
import shutil
import sys
import time
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import atheris
import numpy as np
import pandas  # noqa: F401  # loads for longer than an input may take

INSTRUMENTED = ["pdrbench", "pdrbench_formats", "rosbags", "mcap"]


def modules_of_kernels() -> list[str]:
    """Modules that Numba compiles, which it cannot do once they are instrumented."""
    names = []
    for package in ("pdrbench", "pdrbench_formats"):
        spec = importlib.util.find_spec(package)
        for top in (spec.submodule_search_locations or ()) if spec else ():
            for file in Path(top).rglob("*.py"):
                if re.search(r"^from (pdrbench\.compiled|numba) import", file.read_text(encoding="utf-8"), re.M):
                    names.append(".".join([package, *file.relative_to(top).with_suffix("").parts]))
    return names


KERNELS = modules_of_kernels()

with atheris.instrument_imports(include=INSTRUMENTED, exclude=KERNELS):
    import pdrbench_formats
    from pdrbench.errors import RecordingError
    from pdrbench.io import READERS
    from pdrbench.io.detect import read
    from pdrbench.io.log import Log
    from pdrbench.io.reader import head_of
    from pdrbench.sensors import sensor_spec
    from pdrbench_formats.samples import SAMPLES, make_walk, matlab_mobile, zip_of

MAX_BYTES = 1 << 15
MAX_SEED_BYTES = MAX_BYTES // 2
MAX_READ_BYTES = 1 << 30
MAX_READ_S = 10
WALK_S = 0.4
MARK = b"\n\xff=\xff"  # before each part
NEEDS = {"ros": ("rosbags", "mcap"), "ronin": ("h5py",)}
REAL = {
    "getsensordata": "../ipin2023_track3/logs/*.txt",
    "sensor_logger": "sensor_logger/*",
    "xsens": "xsens_*/*",
    "xio": "xio/*.csv",
    "ros": "ros*/*",
}

Part = tuple[str, bytes]


def pack_input(packing: str, parts: list[Part]) -> bytes:
    """An input of the fuzzer."""
    return packing.encode() + b"".join(MARK + name.encode() + b"\n" + content for name, content in parts)


def unpack_input(data: bytes) -> tuple[str, list[Part]]:
    """Packing and parts of an input."""
    packing, *texts = data.split(MARK)
    parts = []
    for text in texts:
        name, _, content = text.partition(b"\n")
        parts.append((name.decode("utf-8", "replace"), content))
    return packing.decode("utf-8", "replace"), parts


def safe(name: str) -> Path:
    """A relative path without surprises, for files that are written here."""
    kept = [re.sub(r"[^\w .-]", "_", part)[:40] for part in name.split("/")]
    return Path(*[part for part in kept if part.strip(". ")][:5] or ["a"])


def as_file(folder: Path, parts: list[Part]) -> Path:
    """The parts as files; the first is read."""
    places = []
    for name, content in parts:
        place = folder / safe(name)
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
        except OSError:  # a file where a folder has to be
            continue
        places.append(place)
    return places[0] if places else folder


def as_folder(folder: Path, parts: list[Part]) -> Path:
    """The parts as files; the folder is read."""
    as_file(folder / "walk", parts)
    (folder / "walk").mkdir(exist_ok=True)
    return folder / "walk"


def as_zip(folder: Path, parts: list[Part]) -> Path:
    """The parts as members of an archive, under any name."""
    return zip_of(folder / "a.zip", dict(parts))


def as_hdf5(folder: Path, parts: list[Part]) -> Path:
    """Parts named `group/array type rows columns` in an HDF5 file, any other beside it; the folder is read."""
    import h5py

    place = folder / "a000_1"
    place.mkdir()
    with h5py.File(place / "data.hdf5", "w") as file:
        for name, content in parts:
            array, *form = name.split(" ")
            if not form:
                (place / safe(array)).write_bytes(content)
                continue
            try:
                kind = np.dtype(form[0])
                shape = tuple(min(int(size), 5000) for size in form[1:4])
                count = int(np.prod(shape))
                if count > MAX_BYTES:
                    continue
                values = np.frombuffer(content[: len(content) // kind.itemsize * kind.itemsize], kind)
                file[array] = np.resize(values, count).reshape(shape) if len(values) else np.zeros(shape, kind)
            except (ValueError, TypeError, OSError, RuntimeError, KeyError, SyntaxError):
                continue  # no such type, or an array where a group has to be
    return place


def as_bag(folder: Path, parts: list[Part], *, version: int, storage: str = "MCAP") -> Path:
    """Parts named `topic type nanoseconds` as messages of a bag."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    path = folder / ("walk.bag" if version == 1 else "walk")
    writer = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=StoragePlugin[storage])
    with writer:
        topics = {}
        for name, content in parts:
            topic, kind, stamp = (*name.split(" "), "", "", "")[:3]
            kind = kind if kind in store.types else "sensor_msgs/msg/Imu"
            if (topic, kind) not in topics:
                topics[topic, kind] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic, kind], min(int(stamp), 2**62) if stamp.isdecimal() else 0, content)
    return path


def as_json_mcap(folder: Path, parts: list[Part]) -> Path:
    """Parts named `topic schema nanoseconds encoding` as messages of an MCAP file."""
    from mcap.writer import Writer

    path = folder / "walk.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[tuple[str, ...], int] = {}
        for name, content in parts:
            topic, kind, stamp, encoding = (*name.split(" "), "", "", "", "")[:4]
            if (topic, kind, encoding) not in channels:
                schema = writer.register_schema(kind, "jsonschema", b"{}")
                channels[topic, kind, encoding] = writer.register_channel(topic, encoding, schema)
            ns = min(int(stamp), 2**62) if stamp.isdecimal() else 0
            writer.add_message(channels[topic, kind, encoding], ns, content, ns)
        writer.finish()
    return path


PACKINGS: Mapping[str, Callable[[Path, list[Part]], Path]] = {
    "file": as_file,
    "folder": as_folder,
    "zip": as_zip,
    "hdf5": as_hdf5,
    "bag1": lambda folder, parts: as_bag(folder, parts, version=1),
    "bag2": lambda folder, parts: as_bag(folder, parts, version=2),
    "db3": lambda folder, parts: as_bag(folder, parts, version=2, storage="SQLITE3"),
    "mcap": as_json_mcap,
    "raw": as_file,
}


def files_in(path: Path) -> list[Part]:
    """Files of a folder by name."""
    return [(p.relative_to(path).as_posix(), p.read_bytes()) for p in sorted(path.rglob("*")) if p.is_file()]


def cut(content: bytes, size: int) -> bytes:
    """The first lines."""
    return content if len(content) <= size else content[: content.rfind(b"\n", 0, size) + 1 or size]


def inputs_of(path: Path) -> list[bytes]:
    """Inputs that are packed to a recording again, as it is inside and as raw bytes."""
    inputs = []
    if path.is_dir():
        parts = files_in(path)
        if hdf5 := dict(parts).pop("data.hdf5", None):
            inputs += [pack_input("raw", [("data.hdf5", hdf5)]), pack_input("hdf5", arrays_in(path))]
        elif not any(name == "metadata.yaml" for name, _ in parts):
            inputs.append(pack_input("folder", shortened(parts)))
    elif zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            parts = [(name, archive.read(name)) for name in archive.namelist() if not name.endswith("/")]
        inputs += [pack_input("zip", shortened(parts)), pack_input("folder", shortened(parts))]
    elif path.suffix not in (".bag", ".mcap", ".db3"):
        beside = [part for part in files_in(path.parent) if part[0] != path.name] if path.suffix == ".csv" else []
        inputs.append(pack_input("file", shortened([(path.name, path.read_bytes()), *beside[:1]])))
    if path.suffix in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file():
        place = next(iter(sorted(path.glob("*.*3*")) + sorted(path.glob("*.mcap"))), path)
        inputs += [pack_input("raw", [(place.name, place.read_bytes())]), *messages_in(path)]
    return inputs


def shortened(parts: list[Part]) -> list[Part]:
    """Texts of the parts, of which each keeps its first lines."""
    texts = [part for part in parts if not part[0].endswith((".jpg", ".png", ".hdf5"))][:16]
    return [(name, cut(content, MAX_SEED_BYTES // len(texts))) for name, content in texts]


def arrays_in(path: Path) -> list[Part]:
    """Arrays of an HDF5 file, and the files beside it."""
    import h5py

    parts = [part for part in files_in(path) if part[0] != "data.hdf5"]
    with h5py.File(path / "data.hdf5", "r") as file:
        for group in ("synced", "pose"):
            for name, array in file[group].items():
                values = array[()]
                form = " ".join([f"{group}/{name}", values.dtype.str, *map(str, values.shape)])
                parts.append((form, values.tobytes()))
    return parts


def messages_in(path: Path) -> list[bytes]:
    """The first messages of a bag."""
    if path.suffix == ".mcap":
        from mcap.reader import make_reader

        with path.open("rb") as file:
            found = [
                (f"{channel.topic} {schema.name} {message.log_time} {channel.message_encoding}", message.data)
                for schema, channel, message in make_reader(file).iter_messages()
            ]
        return [pack_input("mcap", found[:30])]
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
        messages = [
            (f"{connection.topic} {connection.msgtype} {ns}", bytes(raw))
            for (connection, ns, raw), _ in zip(bag.messages(), range(24), strict=False)
        ]
    packings = ("bag2", "db3") if path.is_dir() else ("bag1",)
    return [pack_input(packing, messages) for packing in packings]


def seeds_of(reader: str) -> list[bytes]:
    """Inputs to begin with."""
    walk = make_walk(WALK_S)
    seeds = []
    with tempfile.TemporaryDirectory() as top:
        for count, sample in enumerate(s for s in SAMPLES.values() if s.reader == reader):
            folder = Path(top) / str(count)
            folder.mkdir()
            seeds += inputs_of(sample.write(folder, walk))
        if reader == "matlab_mobile":
            seeds += inputs_of(matlab_mobile(Path(top), walk))
    for root in os.environ.get("PDRBENCH_DATA", "").split(os.pathsep):
        for path in sorted(Path(root, "samples").glob(REAL[reader]))[:4] if root and reader in REAL else ():
            seeds += inputs_of(path)
    return [seed for seed in seeds if len(seed) <= MAX_BYTES]


FIELD = re.compile(rb"[^,;\t\n: \[\]{}]+")
VALUES = [
    *(
        b"",
        b"0",
        b"-0",
        b"1",
        b"-1",
        b"0.5",
        b"9.81",
        b"nan",
        b"NaN",
        b"inf",
        b"-inf",
        b"null",
        b"None",
        b"true",
        b'""',
    ),
    *(b"1e400", b"-1e400", b"1e308", b"1e-320", b"1e15", b"9223372036854775807", b"18446744073709551616", b"1_0"),
    *(b"1700000000000000000", b"4294967296", b"2147483648", b"0x10", b"1,5", b"\xc2\xb5", b"\xff", b"9" * 400, b'"a'),
    *(b"2023-11-14T23:13:20Z", b"2023-11-14 23:13:20", b"+", b"-", b".", b"\r", b"\0", b'[{"sensor":"Gravity"}]'),
]


def mutate(data: bytes, max_size: int, seed: int) -> bytes:
    """Changes fields, columns, lines and parts as often as bytes."""
    rng = random.Random(seed)
    for _ in range(rng.choice((0, 1, 1, 2, 4))):
        packing, *parts = data.split(MARK)
        if not parts:
            break
        at = rng.randrange(len(parts))
        lines = parts[at].split(b"\n")
        row = rng.randrange(len(lines))
        what = rng.randrange(9)
        if what < 4 and (fields := list(FIELD.finditer(lines[row]))):
            field = rng.choice(fields)
            other = rng.choice(VALUES) if what else rng.choice(fields)[0]
            lines[row] = lines[row][: field.start()] + other + lines[row][field.end() :]
        elif what == 4:
            lines.insert(row, rng.choice(lines))
        elif what == 5:
            del lines[row : row + rng.choice((1, 1, 2, 9))]
        elif what == 6:  # one column of all lines
            place, other = rng.randrange(12), rng.choice(VALUES)
            separator = rng.choice((b",", b";", b"\t"))
            for number, line in enumerate(lines):
                if len(cells := line.split(separator)) > place and number > 1:
                    cells[place] = other
                    lines[number] = separator.join(cells)
        elif what == 7:
            parts.insert(rng.randrange(len(parts) + 1), rng.choice(parts))
            lines = parts[at].split(b"\n")
        elif len(parts) > 1:
            other_at = rng.randrange(len(parts))
            lines[0], parts[other_at] = b"\n".join([parts[other_at].partition(b"\n")[0]]), parts[other_at]
        parts[at] = b"\n".join(lines)
        data = MARK.join([packing, *parts])
    if rng.random() < 0.5:
        data = bytes(atheris.Mutate(data[:max_size], max_size))
    return data[:max_size]


def peak_bytes() -> int:
    """The most memory that this process has had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class Target:
    """Reads inputs, one after the other, in a folder of its own."""

    def __init__(self, reader: str) -> None:
        self.reader = READERS[reader]
        self.kind = reader
        self.top = Path(tempfile.mkdtemp(dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
        self.done = 0
        self.max_s = float(MAX_READ_S)

    def __call__(self, data: bytes) -> None:
        """Raises whatever a reader must not do."""
        self.done += 1
        folder = self.top / "input"
        folder.mkdir()
        try:
            path = self.write(folder, data)
            if path is None:
                return
            before, began = peak_bytes(), time.process_time()
            self.read(path)
            if peak_bytes() - before > MAX_READ_BYTES:
                raise AssertionError(f"{(peak_bytes() - before) >> 20} MiB for {len(data)} bytes")
            if time.process_time() - began > self.max_s:
                raise AssertionError(f"{time.process_time() - began:.1f} s for {len(data)} bytes")
        finally:
            shutil.rmtree(folder)

    def write(self, folder: Path, data: bytes) -> Path | None:
        """An input as a file or folder; None where its packing cannot hold such parts."""
        packing, parts = unpack_input(data)
        try:
            return PACKINGS[packing](folder, parts) if packing in PACKINGS else None
        except Exception:  # noqa: BLE001  # libraries that write bags refuse what they do not know
            return None

    def read(self, path: Path) -> None:
        """Reads as `inspect` and as a task do."""
        try:
            self.reader.sniff(head_of(path))
            log = read(path, self.kind, strict=False)
            if self.reader.hint is not None:
                self.reader.hint(path)
        except RecordingError:
            return
        assert isinstance(log, Log)
        for name, rows in log.rows.items():
            assert np.isfinite(rows).all(), f"{name}: not finite"
            assert (np.diff(rows[:, 0]) >= 0).all(), f"{name}: not in order of time"
            assert not rows.flags.writeable, f"{name}: can be written to"
        assert all(str(finding) for finding in log.findings)
        if not any(finding.severity == "error" for finding in log.findings):
            log.recording("walk", None, sensor_spec)  # what passed as sound is a recording


def missing(reader: str) -> list[str]:
    """Libraries that a reader needs and that are not installed."""
    return [name for name in NEEDS.get(reader, ()) if importlib.util.find_spec(name) is None]


def names() -> list[str]:
    """Readers that can be fuzzed here."""
    recordings = [name for name, place in pdrbench_formats.READERS.items() if ".recordings." in place]
    for name in recordings:
        if missing(name):
            print(f"{name} needs {', '.join(missing(name))}: pip install pdrbench[formats]", file=sys.stderr)
    return [name for name in recordings if not missing(name)]


def main() -> None:
    """Fuzzes one reader."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("reader", nargs="?")
    parser.add_argument("seconds", nargs="?", type=int, default=600)
    parser.add_argument("--list", action="store_true", help="print the readers")
    parser.add_argument("--keep", type=Path, help="file for the input that was found")
    parser.add_argument("--corpus", type=Path, help="folder of inputs to begin with and to add to")
    parser.add_argument("--replay", type=Path, help="an input that was kept")
    options = parser.parse_args()
    if options.list:
        print("\n".join(names()))
        return
    if options.reader not in names():
        parser.error(f"no reader {options.reader!r}; --list prints them")
    warnings.simplefilter("ignore")  # of numbers that overflow
    if options.replay is not None:
        target = Target(options.reader)
        path = target.write(Path(tempfile.mkdtemp()), options.replay.read_bytes())
        print(f"{options.replay} is {path}")
        if path is not None:
            target.read(path)
        return
    corpus = options.corpus or Path(tempfile.mkdtemp())
    corpus.mkdir(parents=True, exist_ok=True)
    with atheris.instrument_imports(include=INSTRUMENTED, exclude=KERNELS):  # readers are loaded on first use
        target = Target(options.reader)
        target.max_s = np.inf  # the first ones compile
        seeds = seeds_of(options.reader)
        if not seeds:
            parser.error(f"no sample of {options.reader}: write one in pdrbench_formats.samples")
        for count, seed in enumerate(seeds):
            (corpus / f"seed-{count}").write_bytes(seed)
            target(seed)
        target.max_s = MAX_READ_S
    keep = options.keep or Path(f"{options.reader}.input")
    atheris.Setup(
        [
            sys.argv[0],
            f"-max_total_time={options.seconds}",
            f"-max_len={MAX_BYTES}",
            f"-rss_limit_mb={(peak_bytes() + 2 * MAX_READ_BYTES) >> 20}",
            f"-timeout={MAX_READ_S}",
            f"-exact_artifact_path={keep}",
            "-error_exitcode=1",
            "-timeout_exitcode=1",
            "-print_final_stats=1",
            str(corpus),
        ],
        target,
        custom_mutator=mutate,
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main()
