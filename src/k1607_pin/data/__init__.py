"""The facts, as TOML, each with its source and its standing."""

import tomllib
from collections.abc import Iterator
from importlib.resources import files
from typing import Any

STANDINGS = ("published", "derived", "assumed", "suspect", "identified")


def load(name: str) -> dict[str, Any]:
    """The data file ``name`` (without ``.toml``) of this package as a dictionary."""
    return tomllib.loads(files(__package__).joinpath(f"{name}.toml").read_text(encoding="utf-8"))


def facts(name: str) -> Iterator[tuple[str, Any, str | None, str | None]]:
    """Every value of the data file ``name``: (dotted path, value, standing, source).

    A table's own ``standing`` and ``source`` hold for all that it contains, unless a table inside says otherwise.
    """

    def walk(table: dict[str, Any], path: str, standing: str | None, source: str | None) -> Iterator[Any]:
        standing, source = table.get("standing", standing), table.get("source", source)
        for key, value in table.items():
            if key in ("standing", "source", "name", "caveat"):
                continue
            here = f"{path}.{key}" if path else key
            if isinstance(value, dict):
                yield from walk(value, here, standing, source)
            else:
                yield here, value, standing, source

    yield from walk(load(name), "", None, None)
