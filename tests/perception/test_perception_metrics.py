import numpy as np
import pytest

from stages.perception.metrics import euclidean_errors, summarise


def test_euclidean_errors_are_distances():
    true = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    estimated = np.array([[3.0, 4.0, 0.0], [1.0, 2.0, 3.5]])
    assert euclidean_errors(true, estimated).tolist() == [5.0, 0.5]


def test_summary_by_hand():
    """Five estimates off by 1, 2, 3, 4 and 10 along x."""
    true = np.zeros((5, 3))
    estimated = np.zeros((5, 3))
    estimated[:, 0] = [1, 2, 3, 4, 10]
    summary = summarise(true, estimated)
    assert summary.mean_error == pytest.approx(4.0)
    assert summary.median_error == pytest.approx(3.0)
    assert summary.p95_error == pytest.approx(8.8)  # 4 + 0.8 · (10 − 4)
    assert summary.loss == pytest.approx((1 + 4 + 9 + 16 + 100) / 5)
    assert summary.bias == pytest.approx([4.0, 0.0, 0.0])


def test_bias_keeps_the_sign_and_cancels():
    true = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]])
    estimated = true + np.array([[0.1, -0.2, 0.3], [-0.1, -0.2, 0.1]])
    assert summarise(true, estimated).bias == pytest.approx([0.0, -0.2, 0.2])


def test_loss_is_the_squared_error_summed_over_axes():
    summary = summarise(np.zeros((1, 3)), np.array([[0.1, 0.2, 0.2]], np.float32))
    assert summary.loss == pytest.approx(0.09)
    assert summary.mean_error == pytest.approx(0.3)
