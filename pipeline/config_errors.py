"""What is wrong with a configuration, in one message: the key, the value, and what would be right."""

from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError

Location = tuple[int | str, ...]
MAX_SHOWN = 3
_OVERRIDES = ("reach", "lift")
_OUT_OF_RANGE = ("greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number")
_LIMITS = {"minimum": ">= {}", "exclusiveMinimum": "> {}", "maximum": "<= {}", "exclusiveMaximum": "< {}"}


def describe(error: ValidationError, model: type[BaseModel], values: dict[str, Any]) -> str:
    """Translate pydantic's errors, at most MAX_SHOWN of them; `values` is what was validated."""
    schema = model.model_json_schema()
    lines = [_describe_one(detail, schema, values) for detail in error.errors() if not _follows_from_another(detail)]
    more = f" (and {len(lines) - MAX_SHOWN} more)" if len(lines) > MAX_SHOWN else ""
    return "; ".join(lines[:MAX_SHOWN]) + more


def _describe_one(detail: Any, schema: dict[str, Any], values: dict[str, Any]) -> str:
    location: Location = detail["loc"]
    key = dotted(in_override(location, values))
    match detail["type"]:
        case "extra_forbidden":
            return _unknown_key(key, location, schema)
        case "literal_error":
            return f"{key} = {detail['input']!r} is not one of: {', '.join(map(str, _node(schema, location)['enum']))}"
        case "value_error":
            return f"{key}: {detail['ctx']['error']}"
        case "model_type" | "model_attributes_type" | "dict_type":
            return f"{key} = {detail['input']!r} is not a section"
        case "missing":
            return f"{key} is missing"
    allowed = _range(_node(schema, location))
    if detail["type"] in _OUT_OF_RANGE:
        return f"{key} = {detail['input']!r} is out of range; allowed: {allowed or 'finite numbers'}"
    reason = detail["msg"].removeprefix("Input ").replace("valid tuple", "list").replace("Tuple", "it")
    return f"{key} = {detail['input']!r}: {reason}" + (f"; allowed: {allowed}" if allowed else "")


def _follows_from_another(detail: Any) -> bool:
    """A list whose items were refused is reported as too short as well."""
    return detail["type"] == "too_short" and len(detail["input"]) > 0


def _unknown_key(key: str, location: Location, schema: dict[str, Any]) -> str:
    valid = sorted(_node(schema, location[:-1]).get("properties", {}))
    close = get_close_matches(str(location[-1]), valid, n=1)
    guess = f" (did you mean {close[0]}?)" if close else ""
    what = "section" if len(location) == 1 else "key"
    return f"unknown {what} {key}{guess}; valid: {', '.join(valid)}"


def in_override(location: Location, values: dict[str, Any]) -> Location:
    """Where the user wrote it: errors in [policy.reach] and [policy.lift] are found in the merged [policy]."""
    if location[:1] == ("policy",) and not _present(values, location):
        for task in _OVERRIDES:
            candidate = ("policy", task, *location[1:])
            if _present(values, candidate):
                return candidate
    return location


def _present(values: Any, location: Location) -> bool:
    for part in location:
        try:
            values = values[part]
        except (KeyError, IndexError, TypeError):
            return False
    return True


def dotted(location: Location) -> str:
    """policy.seeds[0] for ("policy", "seeds", 0)."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")


def _node(schema: dict[str, Any], location: Location) -> dict[str, Any]:
    """JSON schema at a location; empty where the schema says nothing about it."""
    node = schema
    for part in location:
        if isinstance(part, int):
            items = node.get("prefixItems", [])
            node = items[part] if part < len(items) else node.get("items", {})
        else:
            node = node.get("properties", {}).get(part) or _of_any_key(node)
        if "$ref" in node:
            node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    return node


def _of_any_key(node: dict[str, Any]) -> dict[str, Any]:
    """Schema of the values of a section whose keys the user chooses: [studies]."""
    values = node.get("additionalProperties")
    return values if isinstance(values, dict) else {}


def _range(node: dict[str, Any]) -> str:
    return " and ".join(text.format(node[limit]) for limit, text in _LIMITS.items() if limit in node)
