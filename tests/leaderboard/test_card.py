"""Cards: the description of a localizer, refused where it is malformed."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdrbench.errors import BundleError
from pdrbench.registry import localizers
from pdrbench.sensors import SENSORS
from pdrbench_leaderboard.card import Card, card_of, card_toml, read_card, template

from .conftest import EXAMPLE

LINES = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=60)


@settings(max_examples=40, deadline=None)
@given(authors=st.lists(LINES, min_size=1, max_size=4), notes=LINES, map_used=st.booleans())
def test_a_written_card_is_read_back(authors: list[str], notes: str, map_used: bool) -> None:
    card = msgspec.structs.replace(EXAMPLE, authors=tuple(authors), notes=notes, map_used=map_used)
    assert read_card(card_toml(card)) == card


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ('map_used = "yes"\n', "map_used"),
        ('url = "javascript:alert(1)"\n', "url"),
        ('name = "../../etc"\n', "name"),
        ("authors = []\n", "authors"),
        ('division = "both"\n', "division"),
        ("=\n", "Invalid"),
        ("x = " + "[" * 5000, "deep|Invalid"),
        ("#" * 70_000, "bytes"),
    ],
)
def test_malformed_cards_are_errors_of_one_line(change: str, why: str) -> None:
    name = change.partition(" ")[0]
    lines = [line for line in card_toml(EXAMPLE).decode().splitlines() if line.partition(" ")[0] != name]
    with pytest.raises(BundleError, match=why) as error:
        read_card("\n".join([*lines, change]).encode())
    assert "\n" not in str(error.value)


def test_all_faults_are_told_at_once_in_words() -> None:
    text = 'name = "Mine"\nauthors = []\nlicense = "MIT"\nmap_used = "yes"\nsensors_used = ["accel"]\n'
    text += "survey_used = false\n"
    with pytest.raises(BundleError) as error:
        read_card(text.encode(), "card.toml")
    said = str(error.value)
    assert "'license' is no field of a card, did you mean 'licence'?" in said
    assert "map_used = 'yes' is wrong: true or false, without quotes" in said
    assert "name = 'Mine' is wrong: lower-case" in said and "authors = [] is wrong: a list of names" in said
    assert all(f"{field} is missing: " in said for field in ("licence", "training_data"))
    assert "sensors_used" not in said and "Expected" not in said and "pattern" not in said


def test_what_is_no_utf8_and_a_class_without_a_card_are_refused() -> None:
    with pytest.raises(BundleError):
        read_card(b'name = "\xff"')
    with pytest.raises(BundleError, match="submit card"):
        card_of("my_localizer.py:Mine")


def test_the_template_has_every_field_and_is_refused_until_it_is_filled_in() -> None:
    text = template("somewhere/my_localizer.py:ParticleFilter")
    assert 'name = "particle_filter"' in text
    assert [line.partition(" ")[0] for line in text.splitlines()] == list(_order(text, Card.__struct_fields__))
    with pytest.raises(BundleError, match="authors"):
        read_card(text.encode())


def _order(text: str, fields: tuple[str, ...]) -> list[str]:
    """All fields, in the order of the text."""
    return sorted(fields, key=lambda field: text.index(f"\n{field} =") if not text.startswith(field) else -1)


def test_every_registered_localizer_has_a_card() -> None:
    cards = {name: card_of(name) for name in localizers()}
    assert {name: card.name for name, card in cards.items()} == {name: name for name in cards}
    assert {sensor for card in cards.values() for sensor in card.sensors_used} <= set(SENSORS)
