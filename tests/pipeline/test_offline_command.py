"""train-policy --offline: what the sources decide. The stages are fakes; the learning itself is tests/policy's."""

import json
from collections.abc import Callable
from pathlib import Path

from schemas.manifest import config_sha256
from tests.pipeline.fakes import TINY, Run, Stages, prepare, refused

ORACLE = (*TINY, "--set", "policy.schemes=['oracle']")
CELL = "reach-oracle-orbit00-seed0"


def _oracle(run: Run, sees: str) -> None:
    """A run named for what its policy acts on."""
    made = ("--set", f"policy.oracle_sees='{sees}'", "--estimator", "default", "--name", sees)
    done = run("train-policy", *ORACLE, *made)
    assert done.exit_code == 0, done.output


def _learnt(run: Run, stages: Stages, source: str) -> str:
    """What the policy acts on that is learnt from `source`."""
    done = run("train-policy", *ORACLE, "--offline", source, "--name", f"from-{source}")
    assert done.exit_code == 0, done.output
    [spec] = stages.calls_of("train-policy")[-1]["specs"]
    return spec.config.oracle_sees


def test_who_learns_from_logs_acts_on_what_they_were_made_with(run: Run, stages: Stages) -> None:
    prepare(run, "collect", "train-perception")
    for sees in ("truth", "estimate"):
        _oracle(run, sees)
        assert _learnt(run, stages, sees) == sees


def test_logs_older_than_a_key_had_its_default(run: Run, stages: Stages, data: Path, edit: Callable[..., None]) -> None:
    prepare(run, "collect", "train-perception")
    _oracle(run, "truth")
    directory = data / "runs" / "truth" / CELL
    config = json.loads((directory / "manifest.json").read_text())["config"]
    del config["policy"]["oracle_sees"]
    edit(directory, config=config, config_sha256=config_sha256(config))
    assert _learnt(run, stages, "truth") == "truth"


def test_sources_that_act_on_different_things_are_not_mixed(run: Run, stages: Stages) -> None:
    prepare(run, "collect", "train-perception")
    for sees in ("truth", "estimate"):
        _oracle(run, sees)
    mixed = run("train-policy", *ORACLE, "--offline", "truth", "--offline", "estimate", "--name", "mixed")
    refused(mixed, 2, "differ in policy.oracle_sees: learn from them one by one")
