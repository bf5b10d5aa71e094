"""Text from elsewhere, shown on a terminal."""


def printable(text: str, kept: str = "") -> str:
    """`text` with what would move the cursor, change direction or end the line written out, but for what is `kept`.

    Names and messages come from disk: an escape sequence in one must not command the terminal.
    """
    return "".join(each if each.isprintable() or each in kept else repr(each)[1:-1] for each in text)
