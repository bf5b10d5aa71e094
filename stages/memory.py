"""How this process keeps the memory that networks free after every step and want again in the next."""

import ctypes
import platform

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's malloc.h
_LARGEST = 32 * 2**20  # [bytes] glibc's limit


def keep_freed_memory() -> None:
    """Have freed arrays of up to 32 MiB reused instead of returned to the system, where the C library is glibc.

    By default every array above 128 kiB to 32 MiB is mapped, zeroed page by page and unmapped each time: a quarter of
    the time of a TD3 update. What stays resident is what one step needs, about 100 MB.
    """
    if platform.libc_ver()[0] == "glibc":
        libc = ctypes.CDLL(None)
        libc.mallopt(_M_MMAP_THRESHOLD, _LARGEST)
        libc.mallopt(_M_TRIM_THRESHOLD, 2**30)
