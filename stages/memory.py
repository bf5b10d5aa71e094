"""How this process keeps the memory that networks free after every step and want again in the next."""

import ctypes
import os
import platform

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h
_LARGEST = 32 * 2**20  # [bytes] glibc's limit


def keep_freed_memory() -> None:
    """Have freed arrays of up to 32 MiB reused instead of returned to the system, where the C library is glibc.

    By default every array above 128 kiB to 32 MiB is mapped, zeroed page by page and unmapped each time: a quarter of
    the time of a TD3 update. What stays resident is what one step needs, in this process until it ends.
    """
    if platform.libc_ver()[0] == "glibc":
        libc = ctypes.CDLL(None)
        libc.mallopt(_M_MMAP_THRESHOLD, _LARGEST)
        libc.mallopt(_M_TRIM_THRESHOLD, 2**30)


def use_huge_pages() -> None:
    """Have processes started from now on ask for huge pages, where glibc can (2.35) and the user has not tuned it.

    Networks and replay memories of a dozen runs are far apart in memory: a twelfth of a training's time went into
    finding pages.
    """
    os.environ.setdefault("GLIBC_TUNABLES", "glibc.malloc.hugetlb=1")
