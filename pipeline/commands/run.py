"""`pipeline run PROFILE`."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from pipeline.commands.options import StageOptions, stage_options

if TYPE_CHECKING:
    from pipeline.steps.chain import Chain


@click.command(
    epilog="""\b
Example:
  pipeline run demo
  pipeline run laptop --name quick --set policy.seeds='[0]' --dry-run
"""
)
@stage_options
@click.argument("profile_name", metavar="PROFILE", required=False)
def run(options: StageOptions, profile_name: str | None) -> None:
    """All four stages of a profile, doing only what is missing.

    PROFILE is demo, laptop or paper. What was interrupted goes on from its last checkpoint.
    """
    from pipeline.commands.results import failure_message, session, show_plan
    from pipeline.output import print_json
    from pipeline.steps.chain import plan, run_chain
    from schemas.errors import MachineError

    options = _with_profile(options, profile_name)
    work = session(options, resume=True)
    if options.dry_run:
        show_plan(options, "run", plan(work, options.artifact_name))
        return
    chain = run_chain(work, options.artifact_name, None if options.quiet else _announce)
    message = failure_message(chain.cells)
    if not options.as_json and not options.quiet:
        _show(chain)
    if message:
        raise MachineError(message)
    if options.as_json:
        print_json(_as_json(options, chain))


def _with_profile(options: StageOptions, profile: str | None) -> StageOptions:
    from pipeline.config import profiles
    from schemas.errors import ConfigError

    if profile and options.profile and profile != options.profile:
        raise ConfigError(f"two profiles are named, {profile!r} and {options.profile!r}: give one")
    if not (profile or options.profile or options.config_file):
        raise ConfigError(f"name a profile, one of: {', '.join(profiles())}; or give --config FILE")
    return replace(options, profile=profile or options.profile)


def _announce(number: int, stage: str, artifact: str) -> None:
    from pipeline.output import note

    note(f"{number}/4 {stage} → {artifact}")


def _as_json(options: StageOptions, chain: "Chain") -> dict[str, Any]:
    stages = {stage: [each.as_json() for each in outcomes] for stage, outcomes in chain.outcomes.items()}
    return {
        "command": "run",
        "profile": options.profile,
        "status": "complete",
        "stages": stages,
        "seconds": {stage: round(seconds, 3) for stage, seconds in chain.seconds.items()},
        "report": str(chain.report),
        "recordings": [str(path) for path in chain.recordings],
    }


def _show(chain: "Chain") -> None:
    """Results, how long each stage took, and where to look."""
    from pipeline.commands.results import results_table
    from pipeline.output import console, table
    from pipeline.units import duration, figure

    out = console()
    times = table("stage", "#time", "artifact")
    for stage, outcomes in chain.outcomes.items():
        idle = all(outcome.did == "nothing" for outcome in outcomes)
        name = outcomes[0].id if len(outcomes) == 1 else f"{outcomes[0].id.rpartition('/')[0]} ({len(outcomes)} runs)"
        times.add_row(stage, "nothing to do" if idle else duration(chain.seconds[stage]), name)
    out.print(times)
    out.print()
    out.print(results_table(chain.cells))
    error = chain.outcomes["train-perception"][0].summary.get("test_mean_error")
    out.print(f"\nEstimator's mean error on unseen episodes: {figure(error)} m")
    out.print(f"[bold]Report[/]     {chain.report}", soft_wrap=True)
    for path in chain.recordings:
        out.print(f"[bold]Recording[/]  {path}  (open with `rerun {path}`)", soft_wrap=True)
