"""What this project set itself to reach with the `laptop` profile."""

from stages.analyze.claims import KEPT, WHAT, Claim, Quantity, Setting, at, estimator, number


def _target(setting: Setting, quantity: Quantity, value: float) -> Claim:
    return Claim(
        id=f"target-{setting.task}-{setting.scheme}-{quantity}-{setting.misalignment_deg:g}",
        statement=f"{setting.task} at {at(setting.misalignment_deg)}: {setting.scheme}, {WHAT[quantity]}",
        source="target",
        rule="at least",
        quantity=quantity,
        subject=setting,
        value=value,
        paper=f"≥ {number(value, quantity)}",
    )


def _share(degrees: float) -> Claim:
    return Claim(
        id=f"target-reach-dense2sparse-oracle-{degrees:g}",
        statement=f"reach at {at(degrees)}: dense2sparse, share of the oracle's episode reward",
        source="target",
        rule="at least",
        quantity="return",
        subject=Setting("reach", degrees, "dense2sparse"),
        rival=Setting("reach", degrees, "oracle"),
        value=KEPT,
        paper=f"≥ {100 * KEPT:g} %",
    )


TARGETS: tuple[Claim, ...] = (
    estimator("target-estimator", "estimator, mean test error", "target", 0.01),
    _target(Setting("reach", 0, "oracle"), "return", 175),
    _target(Setting("reach", 0, "oracle"), "success", 1.0),
    *(_share(degrees) for degrees in (0.0, 5.0, 10.0)),
    *(_target(Setting("lift", 0, scheme), "return", 330) for scheme in ("oracle", "dense2sparse")),
    *(_target(Setting("lift", 0, scheme), "success", 0.95) for scheme in ("oracle", "dense2sparse")),
)
