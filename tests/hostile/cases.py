"""What hostile inputs are made of."""

import os
from collections.abc import Callable

from hypothesis import settings
from hypothesis import strategies as st

Damage = Callable[[bytes], bytes]


def cases(few: int, many: int) -> settings:
    """So many generated cases by default, and so many in the long profile."""
    return settings(max_examples=many if os.environ.get("HYPOTHESIS_PROFILE") == "long" else few)


def cut(share: float) -> Damage:
    """The file ends early, by at least a byte."""
    return lambda data: data[: min(int(share * len(data)), len(data) - 1)]


def flip(shares: list[float], bit: int) -> Damage:
    """One bit at each of these places, in shares of the file, is another."""

    def damage(data: bytes) -> bytes:
        changed = bytearray(data)
        for place in {min(int(share * len(data)), len(data) - 1) for share in shares}:
            changed[place] ^= 1 << bit
        return bytes(changed)

    return damage


def blank(share: float, length: int) -> Damage:
    """A block of the file is zeros, as a lost sector is."""

    def damage(data: bytes) -> bytes:
        start = min(int(share * len(data)), len(data) - 1)
        changed = data[:start] + bytes(min(length, len(data) - start)) + data[start + length :]
        return changed if changed != data else flip([share], 0)(data)

    return damage


def grow(tail: bytes) -> Damage:
    """The file goes on after its end."""
    return lambda data: data + tail


_share = st.floats(0, 1)
damages: st.SearchStrategy[Damage] = st.one_of(
    st.builds(cut, _share),
    st.builds(flip, st.lists(_share, min_size=1, max_size=4), st.integers(0, 7)),
    st.builds(blank, _share, st.sampled_from([1, 16, 512, 4096])),
    st.builds(grow, st.binary(min_size=1, max_size=20)),
)
"""What disks and hands do to files."""

ODD_NAMES = (
    "", ".", "..", "../x", "a/../../x", "/etc/passwd", "-x", "--help", "a b", "a\nb", "a\tb", "\x1b[31mred", "‮gnp.exe",
    "ünïcödé", "日本", "a" * 300, "'; DROP TABLE runs; --", '"quoted"', "it's", "$(touch canary)", "`touch canary`",
    "%s%n", "{0}", "{{7*7}}", "[bold]", "[/]", "[red", "<script>alert(1)</script>", "*", "?", "[a-z]", "{a,b}", "\\",
    "a\\b", "~", "~root", "NUL", "con.", ".hidden", "a..b", "💥", "javascript:alert(1)", "a;b", "a|b", "a&b", "#a",
)  # fmt: skip

odd_names: st.SearchStrategy[str] = st.one_of(
    st.sampled_from(ODD_NAMES),
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1, max_size=30),
    st.builds("{}{}".format, st.sampled_from(ODD_NAMES), st.sampled_from(ODD_NAMES)),
)
"""Names nobody gives an artifact: never with NUL, which no argument and no file's name can hold."""
