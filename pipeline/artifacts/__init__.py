"""Artifacts: directories that are complete or absent, their manifests, lineage and locks (SPEC §2)."""
