"""No memory left, on the GPU or the host. There is no GPU here: torch's error is raised where one would raise it."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from pipeline.exhausted import message
from stages.collect.collector import Collector
from stages.perception.estimator import Estimator
from stages.perception.frozen import FrozenResNet34
from stages.perception.resnet34 import ResNet34
from stages.policy.td3 import TD3
from stages.sim.processes import portable
from tests.pipeline.tiny_pipeline import ARTIFACTS, check_ended, check_kept, check_resumed, pipeline

GPU = torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.\nSee the documentation.")
HOST = MemoryError("Unable to allocate 2.00 GiB for an array")


def failing(calls: int, original: Callable[..., Any], error: BaseException) -> Callable[..., Any]:
    """`original`, which raises `error` from its call number `calls` on."""
    made = []

    def call(*given: Any, **options: Any) -> Any:
        made.append(1)
        if len(made) >= calls:
            raise error
        return original(*given, **options)

    return call


@pytest.mark.parametrize(
    ("command", "owner", "method", "calls", "error", "said"),
    [
        ("train-perception", ResNet34, "forward", 5, GPU, "a smaller perception.batch_size (or perception.device=cpu)"),
        ("train-perception", ResNet34, "forward", 5, HOST, "a smaller perception.batch_size"),
        ("train-perception", FrozenResNet34, "__call__", 1, GPU, "the GPU is out of memory"),
        ("train-policy", TD3, "update", 40, GPU, "fewer policy.processes and policy.workers, or fewer runs at once"),
        ("train-policy", TD3, "update", 40, HOST, "out of memory: end other programs that use it, then --resume"),
        ("collect", Collector, "_make", 3, HOST, "then --resume with fewer collect.workers"),
    ],
)
@pytest.mark.usefixtures("endless")
def test_it_goes_on_when_there_is_memory_again(
    whole: Path, tmp_path: Path, command: str, owner: type, method: str, calls: int, error: BaseException, said: str
) -> None:
    if command != "collect":
        shutil.copytree(whole / "datasets", tmp_path / "datasets")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(owner, method, failing(calls, getattr(owner, method), error))
        check_ended(pipeline(command, tmp_path), "out of memory", "--resume", said)
    check_kept(tmp_path / ARTIFACTS[command])
    check_resumed(whole, tmp_path, command)


def test_an_estimator_that_a_policy_looks_through(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(whole / "estimators", tmp_path / "estimators")
    monkeypatch.setattr(Estimator, "predict", failing(20, Estimator.predict, GPU))
    seeing = pipeline("train-policy", tmp_path, "--estimator", "n", policy__schemes=["dense"])
    check_ended(seeing, "the GPU is out of memory", "policy.device=cpu")


@pytest.mark.parametrize(
    ("error", "gpu"),
    [
        (GPU, True),
        (RuntimeError("CUDA error: out of memory\nCompile with"), True),
        (RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate(handle)`"), True),
        (RuntimeError("[enforce fail at alloc_cpu.cpp:127] DefaultCPUAllocator: can't allocate memory"), False),
        (OSError(12, "Cannot allocate memory"), False),
    ],
)
def test_whoever_says_so_and_from_whichever_process(error: Exception, gpu: bool) -> None:
    said = message(portable(error), "train-policy", True)
    assert said is not None and said.startswith("the GPU is out of memory" if gpu else "out of memory")
    assert message(ValueError("another shape"), "train-policy", True) is None
    again = message(error, "analyze", False)
    assert again is not None and again.endswith("then the same command again")
