"""Macros of `pipeline sql`: the usual questions, from macros.sql."""

import math
import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import duckdb
import numpy as np
from duckdb.func import FunctionNullHandling
from duckdb.sqltypes import DOUBLE

from stages.analyze.config import AnalyzeConfig
from stages.analyze.statistics import Statistics, Summary, interquartile_mean

_MACRO = re.compile(r"((?:^--.*\n)*)^CREATE MACRO (\w+)\((.*?)\) AS( TABLE)?\s", re.MULTILINE)
_EXAMPLE = "Example: "


@dataclass(frozen=True)
class Macro:
    """One macro that users may call."""

    name: str
    signature: str  # iqm_interval(numbers, confidence := 0.95, samples := 2000)
    is_table: bool  # stands after FROM; else in an expression
    meaning: str
    example: str
    body: str


def define(connection: duckdb.DuckDBPyConnection) -> None:
    """Create the macros, and the functions they call; the views they ask must be there."""
    numbers = duckdb.list_type(DOUBLE)
    null = FunctionNullHandling.SPECIAL  # of one number there is no interval: the answer may be null
    connection.create_function("_iqm", _iqm, [numbers], DOUBLE, null_handling=null)
    connection.create_function("_mean_interval", _mean_interval, [numbers, DOUBLE], numbers, null_handling=null)
    connection.create_function("_iqm_interval", _iqm_interval, [numbers, DOUBLE], numbers, null_handling=null)
    connection.execute(_text())


Numbers = list[float | None] | None


def _iqm(numbers: Numbers) -> float | None:
    known = [x for x in numbers or [] if x is not None and math.isfinite(x)]
    return interquartile_mean(np.array(known)) if known else None


def _mean_interval(numbers: Numbers, confidence: float) -> list[float | None] | None:
    summary = _summary(numbers, confidence)
    return None if summary is None or summary.low is None else [summary.low, summary.high]


def _iqm_interval(numbers: Numbers, confidence: float) -> list[float | None] | None:
    summary = _summary(numbers, confidence)
    return None if summary is None or summary.iqm_low is None else [summary.iqm_low, summary.iqm_high]


def _summary(numbers: Numbers, confidence: float) -> Summary | None:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence is between 0 and 1, not {confidence:g}")
    return Statistics(AnalyzeConfig(confidence=confidence)).of(numbers or [])


@cache
def macros() -> tuple[Macro, ...]:
    """Those there are, in the order of the file."""
    text = _text()
    heads = list(_MACRO.finditer(text))
    ends = [head.start() for head in heads[1:]] + [len(text)]
    found = [_read(head, text[head.end() : end]) for head, end in zip(heads, ends, strict=True)]
    return tuple(macro for macro in found if not macro.name.startswith("_"))


def _read(match: re.Match[str], body: str) -> Macro:
    comment, name, parameters, table = match.groups()
    lines = [line.removeprefix("--").strip() for line in comment.splitlines()]
    examples = [line.removeprefix(_EXAMPLE) for line in lines if line.startswith(_EXAMPLE)]
    meaning = " ".join(line for line in lines if not line.startswith(_EXAMPLE))
    return Macro(name, f"{name}({parameters})", table is not None, meaning, " ".join(examples), body)


@cache
def _text() -> str:
    return files(__package__).joinpath("macros.sql").read_text(encoding="utf-8")
