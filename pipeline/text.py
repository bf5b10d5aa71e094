"""Text from elsewhere, shown on a terminal."""

_LONGEST = 1200  # characters


def shortened(text: str) -> str:
    """`text`, or the beginning and the end of it: a message names what is wrong first, and what would be right last."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]} … {text[-_LONGEST // 3 :]}"


def printable(text: str, kept: str = "") -> str:
    """`text` with what would move the cursor, change direction or end the line written out, but for what is `kept`.

    Names and messages come from disk: an escape sequence in one must not command the terminal.
    """
    return "".join(each if each.isprintable() or each in kept else repr(each)[1:-1] for each in text)
