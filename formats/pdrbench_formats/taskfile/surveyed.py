"""The radio survey of a task: scans of its files and folders, of which each walk is given those of other outings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pdrbench.errors import RecordingError
from pdrbench.recording import RadioMap
from pdrbench_formats.outings import GUARD_S, surveyed
from pdrbench_formats.taskfile import files
from pdrbench_formats.taskfile.files import FileFacts
from pdrbench_formats.taskfile.index import Index
from pdrbench_formats.taskfile.schema import WalkTable
from pdrbench_formats.taskfile.survey import SURVEY_EXAMPLE, Scans, is_survey_table, joined
from pdrbench_formats.taskfile.walk import WalkReader


@dataclass(frozen=True, slots=True)
class Recorded:
    """When a file was recorded, in seconds since 1970."""

    file: Path
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class SurveyFile:
    """One file of a survey.

    Attributes:
        table: As of a walk.
        file: Where it is.
        scans: In it.
        is_surveyed: Whether their places were surveyed.
        facts: Of a recording; None of a table.
    """

    table: WalkTable
    file: Path
    scans: Scans
    is_surveyed: bool
    facts: FileFacts | None

    @property
    def recorded(self) -> Recorded | None:
        """When that was; None of a table, and of a recording without a clock."""
        return None if self.facts is None else recorded(self.file, self.facts)


@dataclass(frozen=True, slots=True)
class Survey:
    """The files of a survey that have scans."""

    files: tuple[SurveyFile, ...]

    def radio_map(self, own: Path, facts: FileFacts) -> RadioMap | None:
        """The scans that a walk is given, from its file and what is known of it."""
        given = self.given(own, facts)
        return joined([one.scans for one in given], surveyed=all(one.is_surveyed for one in given))

    def given(self, own: Path, facts: FileFacts) -> list[SurveyFile]:
        """The files that are neither the walk itself nor of its outing."""
        others, when = [one for one in self.files if one.file != own], recorded(own, facts)
        if when is None:
            return others
        outings = surveyed({when, *filter(None, (one.recorded for one in others))})
        far = {one.file for outing, survey in outings if when in outing for one in survey}
        return [one for one in others if one.recorded is None or one.file in far]

    def note(self, own: Path, facts: FileFacts) -> str:
        """What a user should know of the survey of a walk; empty where it has all files but that of the walk."""
        num_others, left = sum(one.file != own for one in self.files), len(self.given(own, facts))
        if left == num_others:
            return ""
        remedy = f"; walk the survey {GUARD_S / 60:.0f} minutes before or after, or give its readings as a table"
        gone = f"its survey is {left} of {num_others} files: the others are of its own outing"
        return gone if left else gone + remedy


def recorded(file: Path, facts: FileFacts) -> Recorded | None:
    """When a walk was recorded; None where its file does not say."""
    start_s = facts.start_unix_s
    return None if start_s is None else Recorded(file, start_s, start_s + facts.end_s)


def survey_of(reader: WalkReader, walks: Sequence[WalkTable], index: Index) -> tuple[Survey, list[str]]:
    """The survey of walks of a task, and of the files and folders that it names; and what is left out, and why.

    Raises:
        RecordingError: A file that is named is wrong, or has no scan at a place; or no file of a folder has.
    """
    found: dict[Path, SurveyFile] = {}
    problems: list[str] = []
    for named in (*walks, *files.survey_tables(reader.content)):
        tables = files.walks_below(reader.path, reader.content, named, index)
        ones, problems_of = read_files(reader, tables, index, is_strict=[one.file for one in tables] == [named.file])
        problems += problems_of
        if named not in walks and not any(len(one.scans.readings) for one in ones):
            raise RecordingError(
                f"{files.beside(reader.path, named.file)}: no WiFi scan at a place; a survey is a recording with scans "
                f"and places (in NAME_truth.csv beside it, if not in it), a folder of them, or a table {SURVEY_EXAMPLE}"
            )
        found |= {one.file: one for one in ones if len(one.scans.readings)}
    return Survey(tuple(found.values())), problems


def read_files(
    reader: WalkReader, tables: Sequence[WalkTable], index: Index, *, is_strict: bool
) -> tuple[list[SurveyFile], list[str]]:
    """Files of a survey, and why others are left out.

    Raises:
        RecordingError: A file is wrong, and `is_strict`.
    """
    found, problems = [], []
    for table in tables:
        try:
            found.append(_read_file(reader, table, index))
        except RecordingError as error:
            if is_strict:
                raise
            problems.append(f"left out of the survey: {error}")
    return found, problems


def _read_file(reader: WalkReader, table: WalkTable, index: Index) -> SurveyFile:
    place = files.place_of(reader.path, table)
    facts = None if is_survey_table(place) else files.file_facts(reader.path, reader.content, table, index)
    causes = files.causes_of(reader.path, reader.content, table), table, reader.turn, reader.geo
    scans, is_surveyed = index.facts(f"survey {table.file}", tuple[Scans, bool], causes, lambda: reader.scans(table))
    return SurveyFile(table, place, scans, is_surveyed, facts)


def best_surveyed(
    folder: Path, reader: WalkReader, tables: Sequence[WalkTable], index: Index
) -> tuple[list[Path], list[str]]:
    """The walk of a building on whose level most walks of other outings are, and what a user should know.

    Raises:
        RecordingError: No walk of it can be read.
    """
    found, problems = read_files(reader, tables, index, is_strict=False)
    level = {one.file: one.facts.level for one in found if one.facts is not None and one.facts.level is not None}
    if not level:
        raise RecordingError(f"{folder}: no walk with places; {'; '.join(problems) or 'name a recording'}")
    survey = Survey(tuple(found))

    def order(one: SurveyFile) -> tuple[int, int]:
        given = () if one.facts is None or one.file not in level else survey.given(one.file, one.facts)
        return sum(level.get(other.file) == level[one.file] for other in given), len(one.scans.readings)

    best = max(found, key=order).file  # of equal ones that with most readings
    said = f"played: {best.relative_to(folder.resolve())}, with most of the survey on its level"
    return [best], [f"{said}; for another walk: pdrbench try FILE --survey {folder}"]
