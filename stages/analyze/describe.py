"""What can be asked: every view with its columns, every macro. What `pipeline sql --schema` shows."""

from dataclasses import dataclass
from pathlib import Path

from schemas.columns import meaning
from stages.analyze.views import VIEWS, connect


@dataclass(frozen=True)
class Column:
    """One column of a view."""

    name: str
    type: str  # DuckDB's
    meaning: str


def views() -> dict[str, list[Column]]:
    """The columns of every view, in their order. The same whatever has been logged."""
    with connect(Path(), only=[]) as connection:
        return {
            view: [
                Column(name, kind, meaning(view, name))
                for name, kind, *_ in connection.execute(f"DESCRIBE {view}").fetchall()
            ]
            for view in VIEWS
        }
