"""Where is kept what can be made again: below `PIPELINE_CACHE`, else in the user's cache directory."""

import os
from pathlib import Path


def cache_directory() -> Path | None:
    """The directory, which need not be there; None where nothing is to be kept (`PIPELINE_CACHE` is empty)."""
    chosen = os.environ.get("PIPELINE_CACHE")
    if chosen == "":
        return None
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(chosen) if chosen else home / "dense2sparse"
