"""`pipeline run PROFILE`."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.commands.options import ACCUMULATE, EVIDENCE, StageOptions, stage_options

if TYPE_CHECKING:
    from pipeline.steps.chain import Chain


@click.command(
    epilog="""\b
Example:
  pipeline run demo
  pipeline run laptop --name quick --set policy.seeds='[0]' --dry-run
  pipeline run laptop --study switch --evidence results/laptop
"""
)
@stage_options
@click.argument("profile_name", metavar="PROFILE", required=False)
@click.option(
    "--study",
    "studies",
    multiple=True,
    metavar="NAME",
    help="Also train the runs of a study of the profile, [studies.NAME]; repeatable; 'all': every one.",
)
@EVIDENCE
@ACCUMULATE
def run(
    options: StageOptions, profile_name: str | None, studies: tuple[str, ...], evidence: Path | None, accumulate: bool
) -> None:
    """All four stages of a profile, doing only what is missing.

    PROFILE is demo, laptop or paper. What was interrupted goes on from its last checkpoint.

    A study's runs are trained after the main matrix, with the same estimator, as runs/NAME-STUDY-VALUE. The report
    answers every study of which runs are finished.
    """
    from pipeline.commands.results import failure_message, note_left_out, session, show_plan
    from pipeline.evidence import check_directory, copy_evidence, planned_copy
    from pipeline.output import console, print_json
    from pipeline.steps.chain import plan, run_chain, runs_of
    from schemas.errors import MachineError

    options = _with_profile(options, profile_name)
    work = session(options, resume=True)
    check_directory(evidence, options.data, accumulate, runs_of(work, options.artifact_name, studies))
    if options.dry_run:
        show_plan(options, "run", [*plan(work, options.artifact_name, studies), *planned_copy(evidence, accumulate)])
        return
    chain = run_chain(work, options.artifact_name, studies, None if options.quiet else _announce)
    note_left_out(options, chain.left_out)
    message = failure_message(chain.cells)
    shown = not options.as_json and not options.quiet
    if shown:
        _show(chain)
    copy_evidence(chain.report.parent, evidence, accumulate)
    if shown and evidence:
        console().print(f"[bold]Evidence[/]   {evidence}", soft_wrap=True)
    if message:
        raise MachineError(message)
    if options.as_json:
        print_json(_as_json(options, chain, evidence))


def _with_profile(options: StageOptions, profile: str | None) -> StageOptions:
    from pipeline.config import profiles
    from schemas.errors import ConfigError

    if profile and options.profile and profile != options.profile:
        raise ConfigError(f"two profiles are named, {profile!r} and {options.profile!r}: give one")
    if not (profile or options.profile or options.config_file):
        raise ConfigError(f"name a profile, one of: {', '.join(profiles())}; or give --config FILE")
    return replace(options, profile=profile or options.profile)


def _announce(number: int, total: int, stage: str, artifact: str) -> None:
    from pipeline.output import note

    note(f"{number}/{total} {stage} → {artifact}")


def _as_json(options: StageOptions, chain: "Chain", evidence: Path | None) -> dict[str, Any]:
    from pipeline.commands.results import report_json

    stages = {stage: [each.as_json() for each in chain.outcomes(stage)] for stage in chain.stages}
    return {
        "command": "run",
        "profile": options.profile,
        "status": "complete",
        "stages": stages,
        "seconds": {stage: round(chain.seconds(stage), 3) for stage in chain.stages},
        "report": str(chain.report),
        "recordings": [str(path) for path in chain.recordings],
        **report_json(chain.left_out, evidence),
    }


def _show(chain: "Chain") -> None:
    """Results, how long each stage took, and where to look."""
    from pipeline.commands.results import results_table
    from pipeline.output import console, table
    from pipeline.units import duration, figure

    out = console()
    times = table("stage", "#time", "artifact")
    for step in chain.steps:
        idle = all(outcome.did == "nothing" for outcome in step.outcomes)
        count = f" ({len(step.outcomes)} runs)" if step.stage == "train-policy" else ""
        times.add_row(step.stage, "nothing to do" if idle else duration(step.seconds), f"{step.artifact}{count}")
    out.print(times)
    out.print()
    out.print(results_table(chain.cells))
    error = chain.outcomes("train-perception")[0].summary.get("test_mean_error")
    out.print(f"\nEstimator's mean error on unseen episodes: {figure(error)} m")
    out.print(f"[bold]Report[/]     {chain.report}", soft_wrap=True)
    for path in chain.recordings:
        out.print(f"[bold]Recording[/]  {path}  (open with `rerun {path}`)", soft_wrap=True)
