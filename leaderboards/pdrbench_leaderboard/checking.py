"""`submit check`: whether a submission is whole, scores, and looks as an honest one does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation.tables import Results
from pdrbench.registry import localizers, make_task
from pdrbench.result import OFFLINE
from pdrbench.sensors import SENSORS
from pdrbench.settings import split_name
from pdrbench.task import commitment
from pdrbench_leaderboard.bundle import MAX_BUNDLE_BYTES, Bundle, read_bundle
from pdrbench_leaderboard.entry import MAX_FILE_BYTES, Entry, read_entry
from pdrbench_leaderboard.folder_archive import folder_findings
from pdrbench_leaderboard.held_out import scored_again
from pdrbench_leaderboard.manifest import EnvironmentRecord, Manifest
from pdrbench_leaderboard.plausibility import Finding, flags
from pdrbench_leaderboard.schema import read_limited
from pdrbench_leaderboard.suites import Suite, find_suite
from pdrbench_leaderboard.verification import HELD_OUT_FILE

READS: Final = "reads, and every digest fits"


@dataclass(frozen=True, slots=True)
class Checked:
    """What came of a check."""

    findings: tuple[Finding, ...]  # rules, then flags
    entries: tuple[Entry, ...]  # one for each environment that could be read

    @property
    def passed(self) -> bool:
        """Whether every rule is kept; flags do not count."""
        return all(finding.passed or finding.is_flag for finding in self.findings)


def load_bundle(path: Path) -> Bundle:
    """The bundle in a file; raises `BundleError`."""
    return read_bundle(read_limited(path, MAX_BUNDLE_BYTES))


def bundle_of(entry: Entry) -> Bundle:
    """An entry as the bundle of one environment, without source."""
    manifest = msgspec.structs.replace(entry.manifest, source={})
    return Bundle(manifest=manifest, card=entry.card, estimates={entry.env: entry.estimates}, source={})


def check(path: Path) -> Checked:
    """Checks a file `*.pdrz` or a folder `leaderboards/<env>/<localizer>`; what cannot be read is a finding."""
    try:
        if path.is_dir():
            entry = read_entry(path)
            return _with_scores([*rules(entry), _tier(entry), *held_out_findings(entry, path)], [entry])
        bundle = load_bundle(path)
    except PdrbenchError as error:
        return Checked((Finding(READS, False, str(error)),), ())
    return check_bundle(bundle)


def check_bundle(bundle: Bundle) -> Checked:
    """Checks a bundle that could be read."""
    try:
        entries = bundle.entries()
        suite = find_suite(bundle.manifest.suite)
    except PdrbenchError as error:
        return Checked((Finding(READS, False, str(error)),), ())
    findings = [Finding(READS, True), _coverage(bundle.manifest, suite), *folder_findings(bundle.source)]
    for entry in entries:
        findings += [finding for finding in rules(entry) if finding not in findings]
    return _with_scores(findings, entries)


def rules(entry: Entry) -> list[Finding]:
    """Everything that is looked at in one entry but its scores.

    Raises:
        UnknownNameError: There is no such suite, or the environment is none of it.
    """
    suite, manifest, card = find_suite(entry.suite), entry.manifest, entry.card
    is_honest = card.division == OFFLINE or entry.division != OFFLINE
    name, is_registered = manifest.localizer, split_name(manifest.spec)[0] in localizers()
    findings = [
        Finding(READS, True),
        _walks(entry.record, manifest, suite),
        _period(entry.record),
        Finding(f"{entry.env}: division", is_honest, f"{entry.division}, the card says {card.division}"),
    ]
    if split_name(name)[0] in localizers() and manifest.spec != name:
        findings.append(Finding("name", False, f"{name} is registered: choose another name in the card"))
    else:
        findings.append(Finding("name", True, f"no other distribution registers {name}"))
    why = (
        "with its source" if manifest.source else "registered" if is_registered else "only its authors can run it again"
    )
    findings.append(Finding("can be run again", bool(manifest.source) or is_registered, why, is_flag=True))
    unknown = [sensor for sensor in card.sensors_used if sensor not in SENSORS]
    if unknown:
        findings.append(Finding("sensors of the card", False, f"no sensor is named {', '.join(unknown)}"))
    return findings


def _with_scores(findings: Sequence[Finding], entries: Sequence[Entry]) -> Checked:
    """Scores, and flags, where every rule is kept."""
    found = list(findings)
    if all(finding.passed or finding.is_flag for finding in found):
        for entry in entries:
            found += _scores(entry)
    return Checked(tuple(found), tuple(entries))


def _tier(entry: Entry) -> Finding:
    found = entry.verification
    return Finding("tier", True, entry.tier if found is None else f"{found.tier} on {found.date}, signed")


def held_out_findings(entry: Entry, folder: Path) -> list[Finding]:
    """Whether the signed scores come out of the estimates, once the secret and the estimates of a round are public."""
    found = entry.verification and entry.verification.held_out
    suite = find_suite(entry.suite)
    secrets = [secret for secret in suite.published if found and commitment(secret) == found.round]
    if not found or not secrets or not (folder / HELD_OUT_FILE).is_file():
        return []
    content = read_limited(folder / HELD_OUT_FILE, MAX_FILE_BYTES)
    again = scored_again(found, content, entry.env, secrets[0], suite)
    why = "" if again == found else "they do not come out of the estimates on the walks of the published secret"
    return [Finding(f"{entry.env}: held-out scores", again == found, why)]


def _coverage(manifest: Manifest, suite: Suite) -> Finding:
    named = {record.env for record in manifest.environments} | set(manifest.unsuitable) | set(manifest.absent)
    reported = named
    wanted = {listed.env for listed in suite.environments}
    missing, strange = sorted(wanted - reported), sorted(reported - wanted)
    why = f"{len(wanted)} environments"
    if missing or strange:
        why = f"lacks {', '.join(missing)}" if missing else f"{', '.join(strange)} is none of {suite.name}"
    return Finding("reports every environment of the suite", not (missing or strange), why)


def _walks(record: EnvironmentRecord, manifest: Manifest, suite: Suite) -> Finding:
    """Every walk of the suite with every seed, in order."""
    name = f"{record.env}: every walk and seed"
    try:
        walks = suite.walks(record.env)
    except PdrbenchError as error:
        return Finding(name, False, str(error))
    seeds = 1 if record.deterministic else manifest.seeds
    if not record.deterministic and manifest.seeds < suite.seeds:
        return Finding(name, False, f"{manifest.seeds} seeds; {suite.name} has {suite.seeds} where they matter")
    wanted = [(walk, seed) for walk in walks for seed in range(seeds)]
    came = [(walk.walk, walk.seed) for walk in record.walks]
    lacking = [pair for pair in wanted if pair not in came]
    if lacking:
        return Finding(name, False, f"lacks walk {lacking[0][0]} with seed {lacking[0][1]}")
    return Finding(name, wanted == came, f"{len(came)} runs, {len(wanted)} expected")


def _period(record: EnvironmentRecord) -> Finding:
    """The times of estimates follow from the period, so that another one moves them along the walk."""
    period_s = make_task(record.env).period_s
    why = f"{record.period_s:g} s between observations; the environment has {period_s:g} s"
    return Finding(f"{record.env}: period", record.period_s == period_s, "" if record.period_s == period_s else why)


def _scores(entry: Entry) -> Iterator[Finding]:
    suite = find_suite(entry.suite)
    try:
        results = Results(entry.results)
        metrics = results.rows()[0]["metrics"]
        values = {name: metrics.get(name, {}).get("value") for name in suite.metrics}
        shown = (f"{name} {'–' if value is None else f'{value:.4g}'}" for name, value in values.items())
        yield Finding(f"{entry.env}: scores", True, ", ".join(shown))
        yield from flags(entry, suite.environment(entry.env), results.scored)
    except PdrbenchError as error:
        yield Finding(f"{entry.env}: scores", False, str(error))
