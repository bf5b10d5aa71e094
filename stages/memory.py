"""How this process keeps the memory that networks free after every step and want again in the next."""

import ctypes
import os
import platform

import pyarrow as pa

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
    _have_arrow_share()


def _have_arrow_share() -> None:
    """Have Arrow take its memory from the same place, in one thread.

    Its own allocator, and each of its threads, keep what writing a log's part took, more as the part grows and less
    when another begins: of five runs 10 to 30 MB, which looks like a leak (`python -m benchmarks soak`).
    """
    pa.set_memory_pool(pa.system_memory_pool())
    pa.set_cpu_count(1)


def prepare_memory_of_processes() -> None:
    """What can only be said before a process starts, for those started from now on, unless the user has said it.

    Huge pages, where glibc can (2.35): networks and replay memories of a dozen runs are far apart in memory, and a
    twelfth of a training's time went into finding pages. And Arrow's memory from the C library also where Arrow itself
    takes it, which `set_memory_pool` does not reach.
    """
    os.environ.setdefault("GLIBC_TUNABLES", "glibc.malloc.hugetlb=1")
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
