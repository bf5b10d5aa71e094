"""Command line: `python -m benchmarks NAME [--json]`."""

import json
import sys
from importlib import import_module
from pathlib import Path

import click
from rich.console import Console

import stages.sim  # noqa: F401  # chooses the OpenGL backend before MuJoCo is imported
from benchmarks import machine
from benchmarks.show import show
from schemas.errors import PipelineError

BENCHMARKS = {
    "train": "12 reach runs in lockstep, camera and estimator in the loop, against robosuite + ResNet34 + SB3's TD3",
    "scaling": "steps/s of training for 1 to 36 runs in lockstep and 1 and 2 workers, beside the machine's limit",
    "step": "an environment step without camera, against stock robosuite",
    "render": "a 128² frame, against robosuite's offscreen renderer",
    "collect": "kept frames/s on disk as MCAP, against stock stepping and rendering of the same episodes",
    "perception": "images/s of training, against the same network on one batch in memory",
    "td3": "TD3 updates/s per run in lockstep, against stable-baselines3's TD3",
    "log": "share of training time spent on logging, bytes per transition",
    "query": "six analyst questions over ten million transitions",
    "afterwards": "an episode viewed and replayed, a study of 36 runs analysed",
    "crash": "SIGKILL at random moments of every stage, resumed, compared with the uninterrupted one",
    "soak": "memory, file handles and processes over a million transitions, and what is left after every kind of end",
}


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120})
@click.argument("name", type=click.Choice(list(BENCHMARKS)))
@click.option("--json", "as_json", is_flag=True, help="The result as JSON on stdout.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the JSON to this file too.")
@click.option("--quick", is_flag=True, help="Small sizes: whether it works, not how fast it is.")
def main(name: str, as_json: bool, out: Path | None, quick: bool) -> None:
    """Measure NAME side by side with stock in one run: ratios, parts, and the machine's limit.

    \b
    train        12 reach runs in lockstep, camera and estimator in the loop
    scaling      the same for 1, 4, 12 and 36 runs, 1 and 2 workers
    step         one environment step without camera
    render       one frame
    collect      frames on disk as MCAP
    perception   training of the estimator
    td3          TD3 updates
    log          what logging costs
    query        questions over ten million transitions
    afterwards   view, replay, analysis
    crash        kill and resume
    soak         a million transitions

    Close other programs first. What is compared with the public packages needs `make bench`.
    """
    try:
        outcome = import_module(f"benchmarks.{name}").run(quick)
    except ModuleNotFoundError as error:
        click.echo(f"{error.name} is not installed, which stands for stock here: run make bench", err=True)
        sys.exit(4)
    except PipelineError as error:
        click.echo(f"{error}", err=True)
        sys.exit(error.exit_code)
    text = json.dumps(outcome.as_json() | {"quick": quick, "machine": machine.describe()}, indent=2)
    if out:
        out.write_text(text + "\n")
    if as_json:
        click.echo(text)
    else:
        show(outcome, Console())


if __name__ == "__main__":
    main()
