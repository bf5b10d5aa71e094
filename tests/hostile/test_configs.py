"""Configurations that are no TOML, or ask for nonsense: exit code 2 that names the key, or a plan, and soon."""

import time
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline.config import PipelineConfig
from schemas.config import flatten
from tests.hostile.cases import Damage, cases, damages, odd_names
from tests.hostile.ground import Ground

KEYS = tuple(
    key for key, _ in flatten(PipelineConfig().model_dump(mode="json")) if key.count(".") and "studies" not in key
)
VALUES = (
    *("nan", "-nan", "inf", "-inf", "1e308", "-1e308", "-1", "0", "1000000000", "1" + "0" * 30, "-1" + "0" * 30),
    *('""', "true", "[]", "{}", "[[]]", "[nan]", "[inf]", "[1000000000]", "[-1]", "'\\u0000'", '"\\u0000"', '"\x7f"'),
    *("1979-05-27", "07:32:00", "0x7fffffffffffffff", "5e-324", "[1, 2, 3, 4, 5, 6, 7]", '[""]', "{a = 1}", "x"),
    *("[" * 60 + "]" * 60, "[" + "0, " * 3_000 + "0]", "9" * 5_000, '"' + "x" * 3_000 + '"'),
)
"""TOML that is right, and TOML that is not."""
COMMANDS = (("collect",), ("train-policy", "--estimator", "resnet"), ("train-perception", "--dataset", "tiny"))
SOON = 10  # seconds, on a busy machine: a plan takes a tenth of one


def _planned_or_refused(ground: Ground, *arguments: str, key: str | None = None) -> None:
    began = time.monotonic()
    result = ground.ask(*arguments, "--name", "n", "--dry-run", "--data", ground.data)
    assert time.monotonic() - began < SOON
    assert result.exit_code in (0, 2), result.stderr
    if key and result.exit_code:
        assert key.split(".")[1] in result.stderr, result.stderr


@cases(25, 500)
@given(st.sampled_from(KEYS), st.sampled_from(VALUES), st.sampled_from(COMMANDS))
@example("policy.seeds", "[" + ", ".join(map(str, range(2_000))) + "]", ("train-policy", "--estimator", "resnet"))
def test_values(ground: Ground, key: str, value: str, command: tuple[str, ...]) -> None:
    with ground.case("values"):
        _planned_or_refused(ground, *command, "--set", f"{key}={value}", key=key)


@cases(12, 200)
@given(st.one_of(st.text(max_size=60), st.builds("{}={}".format, odd_names, st.text(max_size=20)), odd_names))
@example("policy.td3.hidden.x=1")
@example("a" + ".a" * 5_000 + "=1")  # deeper than Python recurses
@example("world.robot='" + "x" * 100_000 + "'")  # once a message of 100,000 characters
def test_settings_that_are_none(ground: Ground, setting: str) -> None:
    with ground.case("settings"):
        _planned_or_refused(ground, "collect", f"--set={setting}")


def _nested(depth: int) -> bytes:
    return b"world = " + b"[" * depth + b"]" * depth


_STUDY = b"[studies.a]\nquestion='?'\n[studies.a.vary]\n"
_FORTY = b"[" + b", ".join(b"0.%02d" % (i + 1) for i in range(40)) + b"]"
_SIX = (b"gamma", b"tau", b"target_noise", b"exploration_noise", b"learning_rate", b"learning_rate_end")
"""Keys that all take forty values: four thousand million matrices, which once were all made."""
FILES = {
    "empty": b"",
    "NUL": b"\0" * 100,
    "a byte order mark": b"\xef\xbb\xbf[world]\n",
    "UTF-16": "[world]\nrobot = 'Panda'\n".encode("utf-16"),
    "Latin-1": "[world]\nrobot = 'Pandä'\n".encode("latin-1"),
    "binary": bytes(range(256)) * 20,
    "cut in a string": b'[world]\nrobot = "Pan',
    "cut in a section": b"[wor",
    "deep arrays": _nested(20_000),
    "deep tables": b"[" + b".".join([b"a"] * 3_000) + b"]\n",
    "deep inline tables": b"world = " + b"{a = " * 3_000 + b"1" + b"}" * 3_000,
    "a key twice": b"[world]\nrobot = 'Panda'\nrobot = 'Sawyer'\n",
    "a section twice": b"[world]\n[world]\n",
    "a section that is a value": b"world = 3\npolicy = []\ncamera = nan\n",
    "unknown sections": b"[" + b"x" * 5_000 + b"]\n",
    "many unknown sections": b"".join(b"[s%d]\n" % i for i in range(3_000)),
    "a study of itself": _STUDY + b"'studies.a.question'=['a','b']\n",
    "a study of everything": _STUDY + b"".join(b"'policy.td3.%s' = %s\n" % (key, _FORTY) for key in _SIX),
    "a study named as a path": _STUDY.replace(b".a", b".'../x'") + b"'policy.buffer'=['keep']\n",
    "a study of paths": _STUDY + b"'world.robot'=['../../x', 'Panda']\n",
}  # fmt: skip


@pytest.mark.parametrize("content", FILES.values(), ids=FILES)
def test_files(ground: Ground, content: bytes, request: pytest.FixtureRequest) -> None:
    file = ground.guard / "config.toml"
    file.write_bytes(content)
    request.addfinalizer(file.unlink)
    with ground.case("config files"):
        for command in COMMANDS:
            _planned_or_refused(ground, *command, "--config", str(file))


@cases(12, 200)
@given(damages)
def test_damaged_files(ground: Ground, damage: Damage) -> None:
    """A configuration of every section, damaged."""
    file = ground.guard / "config.toml"
    file.write_bytes(damage(WHOLE))
    with ground.case("damaged config files"):
        _planned_or_refused(ground, "train-policy", "--estimator", "resnet", "--config", str(file))
    file.unlink()


WHOLE = b"""\
[world]
robot = "Panda"
cube_half_range = 0.15
[camera]
image_size = 64
position = [0.65, 0.0, 1.5]
[policy]
schemes = ["dense", "dense2sparse"]
seeds = [0, 1]
misalignment_degrees = [0.0, 5.0]
[policy.td3]
hidden = [64, 64]
[policy.reach]
switch_episode = 30
[studies.reset]
question = "What do the networks forget?"
[studies.reset.vary]
"policy.reset" = ["none", "all"]
"""


@pytest.mark.parametrize("path", ["/", "/dev/null", "/proc/self/mem", "outside.txt", "x" * 300, "nowhere/x.toml"])
def test_files_that_are_none(ground: Ground, path: str) -> None:
    with ground.case("config files"):
        _planned_or_refused(ground, "collect", "--config", path)


ABSURD = (
    *(("camera.image_size", 10**9), ("collect.episodes", 10**12), ("collect.steps", 10**9), ("world.horizon", 10**9)),
    *(("policy.td3.hidden", [10**9]), ("policy.td3.batch_size", 10**12), ("policy.td3.buffer_size", 10**15)),
    *(("policy.episodes", 10**12), ("policy.eval_episodes", 10**12), ("policy.final_episodes", 10**12)),
    *(("policy.updates_per_step", 10**9), ("policy.warmup_episodes", 10**12), ("policy.td3.hidden", [1] * 10**4)),
    *(("camera.position", [1e308] * 3), ("camera.target", [-1e308] * 3)),
    *(("policy.td3.exploration_noise", 1e308), ("policy.td3.target_noise", 1e308), ("policy.td3.hidden", [])),
    *(("policy.td3.behaviour_cloning", 1e308), ("policy.td3.preactivation_penalty", 1e308)),
)


@pytest.mark.parametrize(("key", "value"), ABSURD)
def test_what_no_machine_can_do(ground: Ground, key: str, value: Any) -> None:
    """Right by its type, absurd by its size: refused with the range."""
    with ground.case("absurd values"):
        refused = ground.refused(
            "train-policy", "--dry-run", "--estimator", "resnet", "--set", f"{key}={value}", codes=(2,)
        )
        assert key in refused.stderr
        assert "allowed: " in refused.stderr or " at most " in refused.stderr or " at least " in refused.stderr
