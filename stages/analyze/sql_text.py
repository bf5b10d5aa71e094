"""Text inside SQL."""


def literal(text: str) -> str:
    """`text` as SQL has it."""
    return "'" + text.replace("'", "''") + "'"
