"""Six questions that an analyst asks of a study, and one of them asked as `pipeline sql` does, in a fresh process."""

import io
import json
import resource
import sys
import time
from pathlib import Path

QUESTIONS = {
    "return by scheme": """
        WITH each AS (
            SELECT task, misalignment_deg, scheme, run,
                   sum(reward_dense_true) / count(*) FILTER (WHERE truncated) AS episode_return
            FROM transitions WHERE split = 'final' GROUP BY ALL
        )
        SELECT task, misalignment_deg, scheme, avg(episode_return) AS mean, stddev_samp(episode_return) AS std
        FROM each GROUP BY ALL ORDER BY ALL""",
    "reward error by distance": """
        SELECT task, misalignment_deg, 0.02 * floor(distance_true / 0.02) + 0.01 AS distance,
               avg(abs(reward_dense_est - reward_dense_true)) AS error,
               avg(reward_dense_est - reward_dense_true) AS bias
        FROM transitions WHERE scheme <> 'oracle' AND distance_true < 0.5 GROUP BY ALL ORDER BY ALL""",
    "error by misalignment": """
        SELECT misalignment_kind, misalignment_deg, avg(estimation_error) AS mean,
               quantile_cont(estimation_error, 0.95) AS p95
        FROM transitions GROUP BY ALL ORDER BY ALL""",
    "success over time": """
        WITH each AS (
            SELECT task, misalignment_deg, scheme, run, episode, bool_or(success) AS succeeded,
                   min(step) FILTER (WHERE success) AS steps
            FROM transitions WHERE split = 'train' GROUP BY ALL
        )
        SELECT task, misalignment_deg, scheme, 20 * (episode // 20) AS from_episode,
               avg(succeeded::INT) AS success_rate, avg(steps) AS steps
        FROM each GROUP BY ALL ORDER BY ALL""",
    "worst episodes": """
        SELECT run, split, episode, sum(reward_dense_true) AS episode_return, min(distance_true) AS closest,
               max(estimation_error) AS largest_error
        FROM transitions WHERE split <> 'train' GROUP BY ALL ORDER BY episode_return, run, split, episode LIMIT 20""",
    "switch effect": """
        WITH each AS (
            SELECT task, misalignment_deg, run, episode, any_value(phase) AS phase,
                   sum(reward_dense_true) AS episode_return
            FROM transitions WHERE scheme = 'dense2sparse' AND split = 'train' AND phase <> 'warmup' GROUP BY ALL
        ), placed AS (
            SELECT *, episode - min(episode) FILTER (WHERE phase = 'sparse') OVER (PARTITION BY run) AS since FROM each
        )
        SELECT task, misalignment_deg, avg(episode_return) FILTER (WHERE since BETWEEN -50 AND -1) AS before,
               avg(episode_return) FILTER (WHERE since BETWEEN 0 AND 49) AS after
        FROM placed GROUP BY ALL ORDER BY ALL""",
}
COLUMNS = {  # that a question reads, besides words and booleans
    "return by scheme": ["reward_dense_true"],
    "reward error by distance": ["distance_true", "reward_dense_est", "reward_dense_true"],
    "error by misalignment": ["estimation_error"],
    "success over time": ["episode", "step"],
    "worst episodes": ["episode", "reward_dense_true", "distance_true", "estimation_error"],
    "switch effect": ["episode", "reward_dense_true"],
}
BARE = {
    name: "SELECT " + ", ".join(f"sum({column})" for column in columns) + " FROM transitions"
    for name, columns in COLUMNS.items()
}
"""The least that can be done with those columns: one sum each."""


def main() -> None:
    """Answer the SQL on stdin over the data root in the first argument; one JSON object on stdout."""
    from stages.analyze.query import run_sql

    root, sql, answer = Path(sys.argv[1]), sys.stdin.read(), io.StringIO()
    started = time.perf_counter()
    rows = run_sql(root, sql, "csv", None, answer)
    seconds = time.perf_counter() - started
    print(json.dumps({"seconds": seconds, "rows": rows, "peak_bytes": _peak_bytes(), "answer": answer.getvalue()}))


def _peak_bytes() -> int:
    """Peak resident memory of this process; `ru_maxrss` would count the parent's before exec."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return 1024 * int(line.split()[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    main()
