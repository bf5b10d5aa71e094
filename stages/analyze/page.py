"""HTML pages of one file: they open offline in light and dark, with everything they need inside."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import vl_convert
from markupsafe import Markup

from stages.analyze import formats
from stages.analyze.figures import export, theme
from stages.analyze.figures.figure import Figure
from stages.analyze.results import SCHEMES, schemes_of

_ENVIRONMENT = jinja2.Environment(
    loader=jinja2.PackageLoader("stages.analyze"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def render(template: str, figures: Sequence[Figure], **shown: Any) -> str:
    """A page of `template`, which extends `page.html.j2`, with the charts of its figures."""
    return _ENVIRONMENT.get_template(template).render(
        schemes=SCHEMES,
        charts=_charts(figures),
        css=Markup(_text("page.css") + _swatches()),
        script=Markup(_text("page.js")),
        bundle=Markup(_bundle()),
        **shown,
    )


def _charts(figures: Sequence[Figure]) -> dict[str, Any]:
    themes = {"light": theme.config(dark=False), "dark": theme.config(dark=True)}
    return {"themes": themes, "figures": {figure.id: export.page_specification(figure) for figure in figures}}


def _text(name: str) -> str:
    return (Path(__file__).parent / "templates" / name).read_text(encoding="utf-8")


def _swatches() -> str:
    rules = [f".swatch.{scheme} {{ background: {colour}; }}" for scheme, colour in theme.COLOURS.items()]
    oracle = theme.COLOURS["oracle"]
    dashed = f".swatch.oracle {{ background: repeating-linear-gradient(90deg, {oracle} 0 5px, transparent 5px 9px); }}"
    return "\n".join([*rules, dashed])


@cache
def _bundle() -> str:
    """Vega, Vega-Lite and Vega-Embed; a closing tag inside a string must not end the script."""
    return vl_convert.javascript_bundle("window.vegaEmbed = vegaEmbed;").replace("</script", "<\\/script")


_ENVIRONMENT.filters |= {**formats.FILTERS, "schemes_of": schemes_of}
