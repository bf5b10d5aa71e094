"""`pipeline show`."""

from typing import TYPE_CHECKING, Any

import click

from pipeline.commands.options import Place, place_options

if TYPE_CHECKING:
    from rich.tree import Tree

    from pipeline.artifacts.inputs import Lineage
    from schemas.manifest import Code, Environment


@click.command(
    epilog="""\b
Example:
  pipeline show runs/demo/reach-dense2sparse-orbit00-seed0
  pipeline show reports/demo --json
"""
)
@place_options
@click.argument("artifact")
def show(options: Place, artifact: str) -> None:
    """Show one artifact with its lineage back to the first input.

    ARTIFACT is datasets/NAME, estimators/NAME, runs/NAME/CELL, reports/NAME, or a bare name when only one has it.
    """
    from pipeline.artifacts.inputs import lineage, resolve
    from pipeline.output import console, print_json

    found = lineage(options.data, resolve(options.data, artifact))
    if options.as_json:
        assert found.manifest is not None
        print_json({**found.manifest.model_dump(mode="json"), "lineage": _as_json(found)})
    else:
        console().print(_tree(found))


def _as_json(node: "Lineage") -> dict[str, Any]:
    manifest = node.manifest
    return {
        "id": node.id,
        "status": manifest.status if manifest else "missing",
        "created_at": manifest.created_at if manifest else None,
        "changed": node.changed,
        "inputs": [_as_json(each) for each in node.inputs],
    }


def _tree(node: "Lineage") -> "Tree":
    """The artifact with everything about it; its inputs a line each, back to the first."""
    from rich.markup import escape
    from rich.tree import Tree

    from pipeline.text import printable

    tree = Tree(_title(node))
    for label, text in _facts(node):
        tree.add(f"[dim]{escape(printable(label))}[/] {escape(printable(text))}")
    _add_inputs(tree, node, set())
    return tree


def _add_inputs(tree: "Tree", node: "Lineage", shown: set[str]) -> None:
    """An input that several artifacts share is followed back once."""
    if not node.inputs:
        return
    inputs = tree.add("made from")
    for each in node.inputs:
        branch = inputs.add(_title(each))
        if each.id in shown:
            continue
        shown.add(each.id)
        _add_inputs(branch, each, shown)


def _title(node: "Lineage") -> str:
    from rich.markup import escape

    from pipeline.commands.list import headline
    from pipeline.text import printable

    name = escape(printable(node.id))
    if node.manifest is None:
        return f"[bold]{name}[/] [red]gone since[/]"
    changed = " [red]changed since it was the input[/]" if node.changed else ""
    return (
        f"[bold]{name}[/] {node.manifest.status}{changed}  [dim]{escape(printable(headline(node.manifest.summary)))}[/]"
    )


def _facts(node: "Lineage") -> list[tuple[str, str]]:
    from pipeline.commands.results import scalars
    from pipeline.units import figure, size

    manifest = node.manifest
    assert manifest is not None
    total = sum(file.bytes for file in manifest.files)
    return [
        ("made", f"{manifest.created_at} by {manifest.stage} {_version(manifest.code)}"),
        ("on", _machine(manifest.environment)),
        *(("begun", f"by {_version(each.code)} on {_machine(each.environment)}") for each in manifest.resumed_from),
        ("files", f"{len(manifest.files)}, {size(total)}"),
        ("config", manifest.config_sha256[:12]),
        *((key, figure(value)) for key, value in scalars(manifest.summary).items()),
    ]


def _version(code: "Code") -> str:
    commit = f", commit {code.git_commit[:10]}" if code.git_commit else ""
    return f"{code.version}{commit}{' with changes' if code.dirty else ''}"


def _machine(environment: "Environment") -> str:
    named = [environment.cpu, environment.gpu, environment.gl_renderer]
    device = [f"networks on {environment.device}"] if environment.device else []
    return ", ".join([each for each in named if each] + device)
