"""Settings in the name of a localizer: `li2012?map=false&num_particles=500` sets two fields of its `params`.

The class, or the function that makes a localizer, takes a keyword `params` whose default is an instance of a frozen
dataclass. Fields of records inside are written with dots, `filter.max_particles=500`; the items of a tuple with commas.
Characters that have a meaning in a name are written as in the address of a web page, `%26` for `&`.
"""

from __future__ import annotations

import dataclasses
import difflib
import inspect
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final
from urllib.parse import quote, unquote

import msgspec

from pdrbench.errors import PdrbenchError

MARK: Final = "?"  # between the name of a localizer and its settings
PARAMS: Final = "params"  # the argument that settings are fields of
NONE: Final = ("none", "null")
SEQUENCES: Final = (tuple, list, set, frozenset)
PLAIN: Final = "+,:/@"  # besides letters and digits, characters of a value that are written as they are


class SettingsError(PdrbenchError):
    """The settings in the name of a localizer are not fields of its `params`, or not of their types."""


def split_name(name: str) -> tuple[str, str]:
    """The name of a localizer without its settings, and these.

    >>> split_name("li2012?map=false"), split_name("li2012")
    (('li2012', 'map=false'), ('li2012', ''))
    """
    plain, _, query = name.partition(MARK)
    return plain, query


def join_name(plain: str, query: str) -> str:
    """A name with settings; `split_name` takes it apart."""
    return f"{plain}{MARK}{query}" if query else plain


def with_settings_of(name: str, plain: str) -> str:
    """Another name of the same localizer, with its settings.

    >>> with_settings_of("li2012?map=false", "package.module:Li2012")
    'package.module:Li2012?map=false'
    """
    return join_name(plain, split_name(name)[1])


def with_settings(name: str, settings: Mapping[str, Any]) -> str:
    """The name of a localizer with more settings, by field.

    >>> with_settings("li2012?map=false", {"carry_s": 0.8})
    'li2012?map=false&carry_s=0.8'
    """
    plain, query = split_name(name)
    more = [f"{field}={_quoted(_text(value))}" for field, value in settings.items()]
    return join_name(plain, "&".join([query, *more] if query else more))


def sorted_query(query: str) -> str:
    """Settings in the order of their fields; raises `SettingsError` where one is not of the form `field=value`.

    >>> sorted_query("b=2&a=1")
    'a=1&b=2'
    """
    return "&".join(f"{field}={_quoted(text)}" for field, text in sorted(_pairs(query).items()))


def default_params(make: Callable[..., Any]) -> Any:
    """The default of `params` of a class or function; None where it takes none, or its default is no dataclass."""
    try:
        argument = inspect.signature(make).parameters.get(PARAMS)
    except (TypeError, ValueError):  # no signature, as of some compiled functions
        return None
    found = None if argument is None else argument.default
    return found if dataclasses.is_dataclass(found) and not isinstance(found, type) else None


def read_query(make: Callable[..., Any], query: str, who: str) -> Any:
    """The `params` that settings ask for.

    Args:
        make: Class of a localizer, or function that makes one.
        query: Settings, such as `map=false&num_particles=500`.
        who: What errors call the localizer.

    Raises:
        SettingsError: It takes no settings, has no such field, or a value is not of the type of its field.
    """
    return _read(make, query, who)[0]


def canonical_query(make: Callable[..., Any], query: str, who: str) -> str:
    """The same settings in sorted order, without those that are the defaults; arguments and errors of `read_query`."""
    return _read(make, query, who)[1]


def _read(make: Callable[..., Any], query: str, who: str) -> tuple[Any, str]:
    default = default_params(make)
    if default is None:
        raise SettingsError(f"{who} takes no settings; got {MARK}{query}")
    fields = dict(_fields(default))
    params, kept = default, []
    for field, text in sorted(_pairs(query).items()):
        if field not in fields:
            raise SettingsError(_unknown(field, fields, who))
        kind, present = fields[field]
        value = _convert(text, kind, f"{field} of {who} is {_kind_text(kind)}, by default {_text(present)}")
        if value != present:
            params = _replaced(params, field.split("."), value, who)
            kept.append(f"{field}={_quoted(_text(value))}")
    return params, "&".join(kept)


def _pairs(query: str) -> dict[str, str]:
    """Text by field."""
    found: dict[str, str] = {}
    for part in query.split("&"):
        field, sign, text = part.partition("=")
        if not (field and sign):
            raise SettingsError(f"settings are written field=value, with & between them; got {part!r} in {query!r}")
        if field in found:
            raise SettingsError(f"the setting {field!r} stands twice in {query!r}")
        found[field] = unquote(text)
    return found


def _fields(params: Any, before: str = "") -> Iterator[tuple[str, tuple[Any, Any]]]:
    """Type and present value by the dotted name of each field; records inside are listed field by field."""
    try:
        kinds: Mapping[str, Any] = typing.get_type_hints(type(params))
    except NameError:  # a type that is imported for type checkers only
        kinds = {}
    for field in dataclasses.fields(params):
        value = getattr(params, field.name)
        if not field.init:
            continue
        if dataclasses.is_dataclass(value):
            yield from _fields(value, f"{before}{field.name}.")
        else:
            yield f"{before}{field.name}", (kinds.get(field.name, type(value)), value)


def _unknown(field: str, fields: Mapping[str, Any], who: str) -> str:
    near = difflib.get_close_matches(field, fields, n=1, cutoff=0.5)
    meant = f"did you mean {near[0]!r}? " if near else ""
    return f"{who} has no setting {field!r}; {meant}its settings: {', '.join(sorted(fields))}"


def _convert(text: str, kind: Any, expected: str) -> Any:
    """The value of a type that a text stands for; `expected` is for the error."""
    parts = (
        typing.get_args(kind) if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union else ()
    )
    if text.lower() in NONE and (type(None) in parts or kind is type(None)):
        return None
    is_sequence = any((typing.get_origin(part) or part) in SEQUENCES for part in parts or (kind,))
    value = [item for item in text.split(",") if item] if is_sequence else text
    if typing.get_origin(kind) is typing.Literal:
        by_text = {_text(choice): choice for choice in typing.get_args(kind)}
        if text in by_text:
            return by_text[text]
    try:
        return msgspec.convert(value, kind, strict=False)
    except msgspec.ValidationError:
        raise SettingsError(f"{expected}; got {text!r}") from None
    except TypeError:  # a type that no text stands for
        raise SettingsError(f"{expected}, which no text can say; set it in Python") from None


def _replaced(params: Any, path: list[str], value: Any, who: str) -> Any:
    """The record with one field replaced, which may be that of a record inside."""
    name, *inner = path
    if inner:
        value = _replaced(getattr(params, name), inner, value, who)
    try:
        return dataclasses.replace(params, **{name: value})
    except (PdrbenchError, ValueError) as error:  # what the record itself demands of its fields
        raise SettingsError(f"{who} cannot have {name}={_text(value)}: {error}") from error


def _text(value: Any) -> str:
    """A value as it is written in a name.

    >>> _text(True), _text(None), _text(5.0), _text((1, 2.5))
    ('true', 'none', '5', '1,2.5')
    """
    if value is None or isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    if isinstance(value, SEQUENCES):
        return ",".join(map(_text, value))
    return str(getattr(value, "value", value))  # of a member of an Enum


def _quoted(text: str) -> str:
    return quote(text, safe=PLAIN)


def _kind_text(kind: Any) -> str:
    """How an error names a type."""
    if typing.get_origin(kind) is typing.Literal:
        return f"one of {', '.join(map(_text, typing.get_args(kind)))}"
    return "none" if kind is type(None) else getattr(kind, "__name__", "") if isinstance(kind, type) else str(kind)
