"""What the columns of the SQL views mean, from columns.toml."""

import tomllib
from functools import cache
from importlib.resources import files


def meaning(view: str, column: str) -> str:
    """Meaning and unit of a view's column.

    Raises:
        KeyError: nothing is written down about it.
    """
    known = _known()
    return known.get(view.removeprefix("relabelled_"), {}).get(column) or known["common"][column]


def documented() -> dict[str, tuple[str, ...]]:
    """Columns by view, and under `common`, that something is written down about."""
    return {view: tuple(columns) for view, columns in _known().items()}


@cache
def _known() -> dict[str, dict[str, str]]:
    return tomllib.loads(files(__package__).joinpath("columns.toml").read_text(encoding="utf-8"))
