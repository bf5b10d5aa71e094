"""What the paper reports, each number with the place it is from. Only numbers that its text states.

Y. Luo, K. Dong, L. Zhao, Z. Sun, C. Zhou, B. Song: "Balance Between Efficient and Effective Learning: Dense2Sparse
Reward Shaping for Robot Manipulation with Environment Uncertainty".
"""

from dataclasses import dataclass

ESTIMATOR_ERROR = 0.014
"""Mean Euclidean error after 500 epochs on 80 k images [m]; §IV, Fig. 1."""
ESTIMATOR_SOURCE = "§IV, Fig. 1"
SEEDS = 3
"""Per curve; §VI-A."""
ROBOT = "SCR5"
"""§V-B; its scene is not described but for the cube's size."""
DISCOUNT = 0.9
"""Of both tasks; §III."""


@dataclass(frozen=True)
class PaperResult:
    """One scheme of one figure. Approximate, as the paper gives them; None where its text gives no number."""

    task: str
    misalignment_deg: float
    scheme: str
    episode_return: float | None
    success_rate: float | None
    source: str


RESULTS = (
    PaperResult("reach", 0, "oracle", None, 1.00, "§VI-A, Fig. 4(b)"),  # "slightly higher" return than dense2sparse
    PaperResult("reach", 0, "dense2sparse", 175, 1.00, "§VI-A, Fig. 4(a, b)"),
    PaperResult("reach", 0, "dense", 165, 1.00, "§VI-A, Fig. 4(a, b)"),  # "about 10 less than" dense2sparse
    PaperResult("reach", 0, "sparse", 120, 0.95, "§VI-A, Fig. 4(a, b)"),
    PaperResult("reach", 5, "dense2sparse", 175, 1.00, "§VI-A, Fig. 4(c, d)"),  # "nearly unchanged"
    PaperResult("reach", 5, "dense", 155, None, "§VI-A, Fig. 4(c)"),  # "about 75 […] higher" than sparse
    PaperResult("reach", 5, "sparse", 80, 0.50, "§VI-A, Fig. 4(c, d)"),
    PaperResult("reach", 10, "dense2sparse", 175, 1.00, "§VI-A, Fig. 4(e, f)"),
    PaperResult("reach", 10, "dense", 105, None, "§VI-A, Fig. 4(e)"),  # "[about] 50 higher" than sparse
    PaperResult("reach", 10, "sparse", 55, 0.33, "§VI-A, Fig. 4(e, f)"),
    PaperResult("lift", 0, "oracle", 350, 0.99, "§VI-B, Fig. 5"),  # return "nearly equals", success "the same as"
    PaperResult("lift", 0, "dense2sparse", 350, 0.99, "§VI-B, Fig. 5"),
    PaperResult("lift", 0, "dense", 260, 0.65, "§VI-B, Fig. 5"),
    PaperResult("lift", 0, "sparse", 260, 0.60, "§VI-B, Fig. 5"),
)
