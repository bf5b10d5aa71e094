"""What a machine ran out of or refuses, from exceptions of whichever library, and the way out."""

import errno

from pipeline.artifacts.space import is_disk_full

_READ_ONLY = errno.EROFS
_HOST_MEMORY = ("DefaultCPUAllocator: can't allocate memory", "Cannot allocate memory")
_GPU_MEMORY = ("CUDA out of memory", "CUDA error: out of memory", "CUBLAS_STATUS_ALLOC_FAILED")
_LESS = {
    "collect": "with fewer collect.workers",
    "train-policy": "with fewer policy.processes and policy.workers, or fewer runs at once",
}
"""Settings that need less memory and are not part of what is made: an artifact may be resumed with others."""
_SMALLER = {
    "train-perception": "a smaller perception.batch_size (or perception.device=cpu)",
    "train-policy": "a smaller policy.td3.batch_size",
}
"""Settings that need less memory and make another artifact."""


def message(error: BaseException, command: str, resumable: bool) -> str | None:
    """What to tell the user; None for another kind of error."""
    again = "then --resume" if resumable else "then the same command again"
    where = f" ({filename})" if (filename := getattr(error, "filename", None)) else ""
    if is_disk_full(error):
        return f"the disk is full{where}: free space, {again}"
    if isinstance(error, OSError) and error.errno == _READ_ONLY:
        return f"the file system is read-only{where}: make it writable, {again}, or choose another place with --data"
    if isinstance(error, PermissionError):
        return f"permission denied{where}: restore it, {again}, or choose another place with --data"
    if _is_gpu_memory(error):
        return f"the GPU is out of memory: {_way_out(command, resumable, 'policy.device=cpu')}"
    if _is_host_memory(error):
        return f"out of memory: {_way_out(command, resumable, None)}"
    return None


def _way_out(command: str, resumable: bool, elsewhere: str | None) -> str:
    if not resumable:
        return "end other programs that use it, then the same command again"
    less = f" {_LESS[command]}" if command in _LESS else ""
    if elsewhere and command == "train-policy":
        less += f", or with {elsewhere}"
    smaller = f"; or begin under another --name with {_SMALLER[command]}" if command in _SMALLER else ""
    return f"end other programs that use it, then --resume{less}{smaller}"


def _is_gpu_memory(error: BaseException) -> bool:
    """Torch is not imported to be asked: where it raised, its errors are known by name."""
    is_torch = type(error).__name__ == "OutOfMemoryError" and type(error).__module__.startswith("torch")
    return is_torch or (isinstance(error, RuntimeError) and any(sign in str(error) for sign in _GPU_MEMORY))


def _is_host_memory(error: BaseException) -> bool:
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    return isinstance(error, RuntimeError) and any(sign in str(error) for sign in _HOST_MEMORY)
