"""How charts look. Colours and line styles belong to schemes and never change between figures."""

from collections.abc import Sequence
from typing import Any

import altair as alt

from stages.analyze.results import SCHEMES

COLOURS = {"oracle": "#808890", "dense2sparse": "#1a80c4", "dense": "#d55e00", "sparse": "#009e73"}
"""After Okabe and Ito: told apart with any colour vision, at least 3 : 1 against white and against the dark page."""
_DASHES = {"oracle": [5, 3], "dense2sparse": [1, 0], "dense": [1, 0], "sparse": [1, 0]}
_SHAPES = {"oracle": "diamond", "dense2sparse": "circle", "dense": "square", "sparse": "triangle-up"}

SERIES = ("#7a68d8", "#c2508f", "#d98a1f", "#4d9aa8", "#808890")
"""Of what is no scheme: splits, misalignments. None of the schemes' colours but the grey."""
MORE_SERIES = ("#a3586d", "#5b8c5a", "#b5a642", "#3f6fb5", "#8c6d46")
"""Where there are more of them than `SERIES` has."""

_LIGHT = {"text": "#1f2328", "muted": "#59636e", "line": "#d1d9e0", "grid": "#e9edf1"}
_DARK = {"text": "#e6e9ed", "muted": "#9aa4af", "line": "#3a424b", "grid": "#272d34"}
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def scheme_colour(legend: Sequence[str] = ()) -> alt.Color:
    """Colour channel of schemes, with a legend of these; none: without one."""
    scale = alt.Scale(domain=list(SCHEMES), range=[COLOURS[scheme] for scheme in SCHEMES])
    shown = alt.Legend(title=None, symbolOpacity=1, values=list(legend)) if legend else None
    return alt.Color("scheme:N", scale=scale, legend=shown)


def scheme_dash() -> alt.StrokeDash:
    """Line style of schemes."""
    scale = alt.Scale(domain=list(SCHEMES), range=[_DASHES[scheme] for scheme in SCHEMES])
    return alt.StrokeDash("scheme:N", scale=scale, legend=None)


def scheme_shape() -> alt.Shape:
    """Mark of schemes."""
    scale = alt.Scale(domain=list(SCHEMES), range=[_SHAPES[scheme] for scheme in SCHEMES])
    return alt.Shape("scheme:N", scale=scale, legend=None)


def config(dark: bool) -> dict[str, Any]:
    """Vega-Lite configuration for a light or a dark page; the background stays the page's."""
    ink = _DARK if dark else _LIGHT
    return {
        "background": "transparent",
        "font": FONT,
        "view": {"stroke": None},
        "title": {"color": ink["text"], "fontSize": 13, "fontWeight": 600, "anchor": "start", "offset": 10},
        "axis": {
            "labelColor": ink["muted"],
            "titleColor": ink["muted"],
            "labelFontSize": 11,
            "titleFontSize": 11,
            "titleFontWeight": "normal",
            "domainColor": ink["line"],
            "tickColor": ink["line"],
            "gridColor": ink["grid"],
            "tickSize": 4,
        },
        "axisX": {"grid": False},
        "axisY": {"domain": False, "ticks": False, "labelPadding": 6},
        "legend": {"labelColor": ink["text"], "titleColor": ink["muted"], "labelFontSize": 11, "symbolStrokeWidth": 2},
        "text": {"color": ink["muted"], "fontSize": 11},
        "rule": {"color": ink["muted"]},
        "style": {"value-label": {"fill": ink["text"]}, "note": {"fill": ink["muted"]}},
    }
