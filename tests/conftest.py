"""For every room: one thread per library (tests run side by side), no environment that changes what commands do."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.pop("PIPELINE_DATA", None)

from hypothesis import settings

settings.register_profile("pipeline", deadline=None, derandomize=True)
settings.register_profile("long", deadline=None, derandomize=False, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "pipeline"))
