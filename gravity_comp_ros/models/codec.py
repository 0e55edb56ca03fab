"""
Dataclasses as plain values for JSON, and back by their type hints.

A dataclass is an object of its fields, an array or a tuple a list, a mapping an object, a path
its absolute name. `decode`
refuses what JSON would convert silently: a number as text, text as a list, a missing or an unknown
field.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints, Union

import numpy as np


def encode(x: Any) -> Any:
    """Return plain lists, dictionaries, numbers and text; other values are left as they are."""
    if is_dataclass(x):
        return {field.name: encode(getattr(x, field.name)) for field in fields(x)}
    if isinstance(x, (np.ndarray, np.generic)):
        return x.tolist()
    if isinstance(x, Path):
        return str(x.absolute())
    if isinstance(x, Mapping):
        return {key: encode(value) for key, value in x.items()}
    return [encode(value) for value in x] if isinstance(x, (list, tuple)) else x


def decode(kind: Any, value: Any) -> Any:
    """
    Return the value of a type hint from the output of `encode`.

    :param kind: a dataclass, or a type hint of its fields: plain types, `X | None`, tuples,
        paths, mappings from text, and arrays of float64 or int64.
    :raises TypeError: if a value is of another type, or a field is missing or unknown.
    :raises ValueError: if lists of an array have different lengths, or a dataclass refuses.
    :raises OverflowError: if an integer of an array exceeds 64 bits.
    """
    origin, args = get_origin(kind), get_args(kind)
    if kind is Any:
        return value
    if origin in (Union, UnionType):
        *others, last = [each for each in args if each is not type(None)]
        for each in others:
            with suppress(TypeError):
                return decode(each, value)
        return None if value is None else decode(last, value)
    if kind is Path:
        return Path(_checked(value, str))
    if isinstance(kind, type) and is_dataclass(kind):
        parts, hints = _checked(value, dict), get_type_hints(kind)
        names = {field.name for field in fields(kind)}
        if parts.keys() != names:
            raise TypeError(f'{", ".join(sorted(parts.keys() ^ names))} of a {kind.__name__} is '
                            f'missing or unknown')
        return kind(**{name: decode(hints[name], part) for name, part in parts.items()})
    if origin is np.ndarray:
        number = get_args(args[1])[0]
        _check_numbers(_checked(value, list), (int,) if number is np.int64 else (int, float))
        return np.array(value, dtype=number)
    if origin is tuple:
        items = _checked(value, list)
        kinds = args[:1] * len(items) if args[-1] is Ellipsis else args
        return tuple(decode(each, item) for each, item in zip(kinds, items, strict=True))
    if origin is Mapping:
        return {key: decode(args[1], item) for key, item in _checked(value, dict).items()}
    return float(_checked(value, int, float)) if kind is float else _checked(value, kind)


def _checked(value: Any, *kinds: type) -> Any:
    if type(value) not in kinds:
        raise TypeError(f'{str(value)[:40]!r} is not of type {kinds[-1].__name__}')
    return value


def _check_numbers(values: list[Any], kinds: tuple[type, ...]) -> None:
    for value in values:
        if isinstance(value, list):
            _check_numbers(value, kinds)
        else:
            _checked(value, *kinds)
