"""Fetches datasets into the cache folder: resumable, several files at a time, verified, whole or not at all."""

from __future__ import annotations

import contextlib
import hashlib
import http.client
import os
import shutil
import tempfile
import urllib.error
import urllib.parse
import urllib.request
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.resources import files as package_files
from pathlib import Path
from typing import Final

import pooch

from pdrbench.datasets.catalogue import LICENCE, DataFile, Dataset, dataset
from pdrbench.datasets.folders import CACHE_VARIABLE, cache_folder
from pdrbench.datasets.integrity import PARTIAL_FOLDER, difference
from pdrbench.datasets.recipes import RECIPES
from pdrbench.errors import DatasetError
from pdrbench.files import try_lock

PACKAGED: Final = "package:"
MAX_OTHER_BYTES: Final = 4 << 30  # of a source whose size is not registered
_TIMEOUT_S: Final = 30.0
_PARALLEL: Final = 6  # files at a time: one waits for the server while another is packed
_CHUNK_BYTES: Final = 1 << 18
_AGAIN: Final = "run the same command again: it continues where it stopped"

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class Fetched:
    """What a fetch did.

    Attributes:
        folder: Where the set lies now.
        fetched: Paths that were fetched; those that lay there intact are not among them.
        recompressed: Paths whose content is the registered one and whose gzip or xz wrapping is not, because the
            library of this machine compresses differently.
    """

    folder: Path
    fetched: tuple[str, ...]
    recompressed: tuple[str, ...]


def fetch(name: str, *, mirror: str | None = None, progress: Progress | None = None) -> Fetched:
    """Fetches a registered dataset into the cache folder.

    Args:
        name: Registered dataset.
        mirror: Address of a folder laid out like one of `PDRBENCH_DATA`: it serves `<name>/<path>` as registered.
            Without it the files are fetched from their source and made as the recipes say.
        progress: Called with files done, files in all, and the path that comes next.

    Raises:
        DatasetError: It cannot be fetched, is not what was registered, or does not fit on the disk.
    """
    return fetch_into(dataset(name), cache_folder() / name, mirror=mirror, progress=progress)


def fetch_into(
    wanted: Dataset, folder: Path, *, mirror: str | None = None, progress: Progress | None = None
) -> Fetched:
    """The same for any dataset and folder."""
    _check_source(wanted, mirror)
    pooch.get_logger().setLevel("WARNING")  # it would log the hash of every file
    files = [file for file in wanted.files if file.is_required]
    fetched: list[str] = []
    recompressed: list[str] = []
    with _disk_errors(folder), _only_fetch(folder / PARTIAL_FOLDER):
        absent = [file for file in files if not _is_intact(file, folder)]
        _check_space(absent, folder)
        fetch_file = partial(_fetch_file, folder=folder, name=wanted.name, mirror=mirror)
        for is_licence in (True, False):  # a licence comes before what it covers
            now = [file for file in absent if (file.role == LICENCE) is is_licence]
            with ThreadPoolExecutor(_PARALLEL) as pool:  # `map` cancels what has not begun when one fails
                for file, is_same in zip(now, pool.map(fetch_file, now), strict=True):
                    if progress is not None:
                        progress(len(files) - len(absent) + len(fetched), len(files), file.path)
                    if not is_same:
                        recompressed.append(file.path)
                    fetched.append(file.path)
        shutil.rmtree(folder / PARTIAL_FOLDER)
    if progress is not None:
        progress(len(files), len(files), "")
    return Fetched(folder, tuple(fetched), tuple(recompressed))


def fetch_bytes(url: str, sha256: str) -> bytes:
    """A small file, once its content is known to have the given sha256; raises `DatasetError`."""
    file = DataFile(path=url.rpartition("/")[2] or "index", sha256=sha256, bytes=0, role="index", url=url)
    pooch.get_logger().setLevel("WARNING")
    with tempfile.TemporaryDirectory(prefix="pdrbench-") as scratch:
        return _retrieve(url, sha256, file, Path(scratch))


def _check_source(wanted: Dataset, mirror: str | None) -> None:
    """Raises where nothing can be fetched before anything is written."""
    if wanted.by_content:
        raise DatasetError(f"the dataset {wanted.name!r} is registered without its file names: {wanted.how_to_get}")
    if mirror is None and not wanted.is_fetchable:
        raise DatasetError(f"the dataset {wanted.name!r} has no source to fetch from: {wanted.how_to_get}")
    if mirror is not None and urllib.parse.urlsplit(mirror).scheme not in ("http", "https"):
        raise DatasetError(f"a mirror is an http:// or https:// address; got {mirror!r}")


def _is_intact(file: DataFile, folder: Path) -> bool:
    problem = difference(file, folder / file.path)
    return problem is None or problem.is_harmless


def _check_space(absent: list[DataFile], folder: Path) -> None:
    needed_bytes, free_bytes = sum(file.bytes for file in absent), shutil.disk_usage(folder).free
    if needed_bytes > free_bytes:
        raise DatasetError(
            f"{folder} has {free_bytes / 1e6:.1f} MB free, {needed_bytes / 1e6:.1f} MB are needed; "
            f"free some space or set {CACHE_VARIABLE} to another folder"
        )


def _fetch_file(file: DataFile, folder: Path, name: str, mirror: str | None) -> bool:
    """Puts one file in its place; False where its gzip or xz wrapping is not the registered one."""
    scratch = folder / PARTIAL_FOLDER
    if file.url.startswith(PACKAGED):
        content = (package_files("pdrbench.datasets") / "licences" / file.url.removeprefix(PACKAGED)).read_bytes()
    elif mirror is not None:
        content = _retrieve(f"{mirror.rstrip('/')}/{name}/{urllib.parse.quote(file.path)}", file.sha256, file, scratch)
    elif file.recipe == "copy":
        content = _retrieve(file.url, file.sha256, file, scratch)
    else:
        source = _retrieve(file.url, None, file, scratch)
        if git_blob(source) != file.source_blob:
            raise DatasetError(_changed(file.url, file))
        content = RECIPES[file.recipe](source)
    return _write_whole(content, file, folder)


def _retrieve(url: str, sha256: str | None, file: DataFile, scratch: Path) -> bytes:
    """What `url` serves; raises where its sha256 is not the given one. No part of it stays in `scratch`."""
    part = scratch / f"{_scratch_name(file)}.part"
    try:
        place = pooch.retrieve(
            url,
            known_hash=None if sha256 is None else f"sha256:{sha256}",
            fname=f"{_scratch_name(file)}.source",
            path=scratch,
            downloader=partial(_download, part=part, most=file.bytes if sha256 and file.bytes else MAX_OTHER_BYTES),
        )
    except ValueError as error:  # pooch reports a wrong hash so; what it had is deleted
        raise DatasetError(_changed(url, file)) from error
    content = Path(place).read_bytes()
    Path(place).unlink()
    return content


def _scratch_name(file: DataFile) -> str:
    """Of what is not finished: the content is what may be continued; two paths may have one content."""
    return f"{file.sha256[:16]}{zlib.crc32(file.path.encode()):08x}"


def _changed(url: str, file: DataFile) -> str:
    return (
        f"{url} is not the registered {file.path} (its hash differs); nothing was kept: "
        f"try again, and if it stays so the source has changed or something between rewrites it: use --mirror URL"
    )


def git_blob(content: bytes) -> str:
    """Git's id of a file.

    >>> git_blob(b"")
    'e69de29bb2d1d6434b8b29ae775ad8c2e48c5391'
    """
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _write_whole(content: bytes, file: DataFile, folder: Path) -> bool:
    """Writes a file under a temporary name, checks it and renames it; False where only its content is as registered."""
    temporary, target = folder / PARTIAL_FOLDER / f"{_scratch_name(file)}.tmp", folder / file.path
    with temporary.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    problem = difference(file, temporary)
    if problem is not None and not problem.is_harmless:
        temporary.unlink()
        raise DatasetError(f"{file.path}, as made from {file.url}: {problem.why}; use --mirror URL")
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary.replace(target)
    return problem is None


def _download(url: str, output_file: str, _pooch: object, *, part: Path, most: int) -> None:
    """Downloads `url`, at most so many bytes, continuing `part` where that holds its beginning. Called by pooch."""
    have_bytes = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(url, headers={"User-Agent": "pdrbench"})
    if have_bytes:
        request.add_header("Range", f"bytes={have_bytes}-")
    try:
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as response:
            expected_bytes = _append(response, part, have_bytes, most)
    except urllib.error.HTTPError as error:
        if error.code == http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE and have_bytes:
            part.unlink()  # it held everything, or more: begin anew
            return _download(url, output_file, _pooch, part=part, most=most)
        raise DatasetError(
            f"{url}: the server answers {error.code} {error.reason}; try later or --mirror URL"
        ) from error
    except urllib.error.URLError as error:
        raise DatasetError(
            f"cannot reach {urllib.parse.urlsplit(url).netloc}: {error.reason}; check the network, or use --mirror URL"
        ) from error
    except (http.client.HTTPException, ConnectionError, TimeoutError) as error:
        raise DatasetError(f"{url} broke off ({type(error).__name__}); {_AGAIN}") from error
    if part.stat().st_size > most:
        part.unlink()
        raise DatasetError(f"{url} sends more than the {most} bytes that it has; nothing was kept: use --mirror URL")
    if expected_bytes is not None and part.stat().st_size != expected_bytes:
        raise DatasetError(f"{url} broke off after {part.stat().st_size} of {expected_bytes} bytes; {_AGAIN}")
    part.replace(output_file)
    return None


def _append(response: http.client.HTTPResponse, part: Path, have_bytes: int, most: int) -> int | None:
    """Writes a response behind what is there, or from the start where the server sends everything.

    A little more than `most` bytes is written at most, whatever comes.

    Returns:
        Size that `part` should have now; None where the server did not report it.
    """
    continues = response.status == http.HTTPStatus.PARTIAL_CONTENT
    length = response.headers.get("Content-Length")
    with part.open("ab" if continues else "wb") as stream:
        while stream.tell() <= most and (chunk := response.read1(_CHUNK_BYTES)):
            stream.write(chunk)  # what came is kept, also where more never comes
    return None if length is None else int(length) + (have_bytes if continues else 0)


@contextlib.contextmanager
def _disk_errors(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DatasetError(
            f"cannot write to {folder}: {error.strerror or error}; free some space or set {CACHE_VARIABLE} "
            f"to another folder, then {_AGAIN}"
        ) from error


@contextlib.contextmanager
def _only_fetch(scratch: Path) -> Iterator[None]:
    """Keeps a second fetch out of the same folder; the lock goes with its process, however that ends."""
    scratch.mkdir(parents=True, exist_ok=True)
    with (scratch / "lock").open("wb") as file:
        if not try_lock(file):
            raise DatasetError(f"another fetch is writing to {scratch.parent}; wait for it to end")
        yield
