"""Run as a script: unpacks wheels into a folder, confined to both. Orders come as JSON on standard input."""

from __future__ import annotations

import json
import sys
import zipfile
import zlib
from pathlib import Path, PurePosixPath
from typing import IO, Any, Final

MAX_MEMBERS: Final = 60_000  # of a wheel; torch has 12 000
MAX_BYTES: Final = 6_000_000_000  # of all files together
PART_BYTES: Final = 1 << 20
FILE_KIND, PLAIN, NONE = 0o170000, 0o100000, 0
IMPORTED: Final = ("purelib", "platlib")  # parts of `name.data` that can be imported
MEMORY_MB: Final = 2048
CPU_S: Final = 600.0


class WheelError(Exception):
    """A wheel is none."""


def main() -> None:
    """Confines this process, then unpacks."""
    orders: dict[str, Any] = json.load(sys.stdin)
    sys.path[:] = orders["path"]
    confine_to(orders["wheels"], orders["folder"])
    left = MAX_BYTES
    for wheel in orders["wheels"]:
        try:
            with open(wheel, "rb") as file:  # noqa: PTH123  opened once, then read
                left = unpack(file, Path(wheel).name, Path(orders["folder"]), left)
        except WheelError as error:
            raise SystemExit(str(error)) from None
        except OSError as error:
            raise SystemExit(f"{Path(wheel).name}: {error}") from None


def confine_to(wheels: list[str], folder: str) -> None:
    """Gives up every right but to read these files and to write into this folder, as far as the system grants it."""
    from pdrbench.isolation.boot import ProtectionRecord
    from pdrbench.isolation.confine import Limits, confine, detach
    from pdrbench.isolation.landlock import Ruleset

    record = ProtectionRecord()
    "".encode("cp437")  # what zipfile imports later
    try:
        ruleset = Ruleset()
        for wheel in wheels:
            ruleset.read(wheel)
        ruleset.write(folder)
        ruleset.read(str(Path(zipfile.__file__).parent))
    except (OSError, AttributeError) as error:  # the latter where nothing can be confined
        ruleset, why = None, str(error)
    else:
        why = ""
    detach(record, Limits(memory_mb=MEMORY_MB, file_mb=MAX_BYTES >> 20), CPU_S)
    confine(record, ruleset, why)


def unpack(wheel: IO[bytes], name: str, folder: Path, left: int) -> int:
    """Writes what can be imported and what describes it; scripts and files for other places are left out.

    Args:
        wheel: An untrusted file.
        name: What the error calls it.
        folder: Into which it goes.
        left: Bytes that may still be written.

    Returns:
        What is left of them then.

    Raises:
        WheelError: It is no wheel, names a place outside of the folder, or is too large.
    """
    try:
        with zipfile.ZipFile(wheel) as archive:
            infos = archive.infolist()
            if len(infos) > MAX_MEMBERS:
                raise WheelError(f"{name} has {len(infos)} files, {MAX_MEMBERS} are allowed")
            for info in infos:
                path = place_of(info, name)
                if path is None:
                    continue
                with archive.open(info) as file:
                    left = _write(file, folder / path, name, left)
    except WheelError:
        raise
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, ValueError, EOFError, LookupError) as error:
        raise WheelError(f"{name} is no wheel: {type(error).__name__}: {error}") from None
    except (OverflowError, ArithmeticError, MemoryError, zlib.error) as error:
        raise WheelError(f"{name} is no wheel: {type(error).__name__}") from None
    return left


def place_of(info: zipfile.ZipInfo, name: str) -> PurePosixPath | None:
    """Where a member goes, below the folder; None where it is left out. Raises `WheelError`."""
    text = info.filename
    path = PurePosixPath(text)
    is_odd = "\\" in text or "\0" in text or ":" in text or path.is_absolute() or ".." in path.parts
    if is_odd or len(text) > 1000 or not path.parts:
        raise WheelError(f"{name} has a file with the name {text[:80]!r}")
    if info.external_attr >> 16 & FILE_KIND not in (NONE, PLAIN) and not info.is_dir():
        raise WheelError(f"{name}: {text[:80]} is a link or no plain file")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise WheelError(f"{name}: {text[:80]} is compressed as no wheel is")
    if info.is_dir() or path.suffix == ".pth":
        return None
    if path.parts[0].endswith(".data"):
        return PurePosixPath(*path.parts[2:]) if len(path.parts) > 2 and path.parts[1] in IMPORTED else None
    return path


def _write(file: IO[bytes], path: Path, name: str, left: int) -> int:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as written:
            while part := file.read(PART_BYTES):
                left -= len(part)
                if left < 0:
                    raise WheelError(f"{name} has more than {MAX_BYTES} bytes when it is unpacked")
                written.write(part)
    except (FileExistsError, NotADirectoryError, IsADirectoryError):
        raise WheelError(f"{name} has {path.name}, which is there already") from None
    return left


if __name__ == "__main__":
    main()
