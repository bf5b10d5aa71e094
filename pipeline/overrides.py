"""Changing one value of a nested configuration by its dotted key."""

import re
import tomllib
from typing import Any

from schemas.errors import ConfigError

_BARE_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*")


def apply_override(values: dict[str, Any], override: str) -> None:
    """Set one `section.key=value` in nested `values`; the value is a TOML literal, a bare word is a string."""
    key, separator, text = override.partition("=")
    if not separator or not is_dotted(key):
        raise ConfigError(f"--set {override!r} is not of the form section.key=value, such as policy.episodes=300")
    value = parse_value(text.strip(), override)
    try:
        put(values, key, value)
    except ConfigError as error:
        raise ConfigError(f"--set {override!r}: {error}") from error


def is_dotted(key: str) -> bool:
    """The key has a section and a name, none of its parts empty."""
    parts = [part.strip() for part in key.split(".")]
    return len(parts) > 1 and all(parts)


def put(values: dict[str, Any], key: str, value: Any) -> None:
    """Set the value of a dotted key, making the sections on the way; ConfigError where one of them is a value."""
    *sections, last = (part.strip() for part in key.split("."))
    table = values
    for depth, section in enumerate(sections):
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise ConfigError(f"{'.'.join(sections[: depth + 1])} is a value, not a section")
    table[last] = value


def parse_value(text: str, override: str) -> Any:
    """Value of a TOML literal, or the text itself when it is a bare word."""
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError) as error:
        if _BARE_WORD.fullmatch(text):
            return text
        raise ConfigError(
            f"--set {override!r}: the value is no TOML literal such as 3, 0.5, true, [0, 5] or ['dense', 'sparse']"
        ) from error
    if len(parsed) != 1:
        raise ConfigError(f"--set {override!r}: one value only")
    return parsed["value"]
