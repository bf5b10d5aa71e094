"""The questions of the report, as SQL that anyone can ask again with `pipeline sql`."""

from collections.abc import Sequence

from stages.analyze.catalogue import Artifact

_GROUP = "split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme"

OUTCOMES = f"""
-- where each run ended: its final evaluation, or the last one made while training
SELECT run, {_GROUP}, seed, split, after_episode, episodes,
       mean_return, success_rate, mean_steps_to_success, mean_estimation_error
FROM evaluations
WHERE {{runs}}
QUALIFY row_number() OVER (
    PARTITION BY run ORDER BY split = 'final' DESC, after_episode DESC, evaluation DESC
) = 1
ORDER BY run
"""

LEARNING_CURVES = f"""
-- mean and spread over seeds of the evaluations made while training
SELECT {_GROUP}, after_episode,
       avg(mean_return) AS mean, stddev_samp(mean_return) AS std, count(*) AS seeds
FROM evaluations
WHERE split = 'eval' AND {{runs}}
GROUP BY ALL
ORDER BY ALL
"""

SWITCHES = f"""
-- first training episode under the sparse reward
SELECT {_GROUP}, min(episode) AS switch_episode
FROM episodes
WHERE scheme = 'dense2sparse' AND split = 'train' AND phase = 'sparse' AND {{runs}}
GROUP BY ALL
ORDER BY ALL
"""

SWITCH_EFFECT = """
-- last evaluation before the switch against the last one of training; `dense` over the same episodes is the control
WITH curve AS (
    SELECT *, split_part(run, '/', 1) AS name FROM evaluations WHERE split = 'eval' AND {runs}
), switched AS (
    SELECT name, task, misalignment_kind, misalignment_deg, seed,
           max(after_episode) FILTER (WHERE phase <> 'sparse') AS before_episode,
           max(after_episode) FILTER (WHERE phase = 'sparse') AS after_episode
    FROM curve WHERE scheme = 'dense2sparse'
    GROUP BY ALL
    HAVING before_episode IS NOT NULL AND after_episode IS NOT NULL
), ends AS (
    SELECT s.*, c.scheme,
           max(c.mean_return) FILTER (WHERE c.after_episode = s.before_episode) AS before_return,
           max(c.mean_return) FILTER (WHERE c.after_episode = s.after_episode) AS after_return
    FROM switched AS s JOIN curve AS c USING (name, task, misalignment_kind, misalignment_deg, seed)
    WHERE c.scheme IN ('dense', 'dense2sparse')
    GROUP BY ALL
)
SELECT *, after_return - before_return AS change
FROM ends
ORDER BY name, task, misalignment_kind, misalignment_deg, scheme, seed
"""

REWARD_ERROR = """
-- how wrong the dense reward is, and which way, by how far the gripper truly is from the cube (bins of 2 cm)
SELECT split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg,
       0.02 * floor(distance_true / 0.02) + 0.01 AS distance,
       avg(abs(reward_dense_est - reward_dense_true)) AS error,
       avg(reward_dense_est - reward_dense_true) AS bias,
       count(*) AS steps
FROM transitions
WHERE scheme <> 'oracle' AND reward_dense_est IS NOT NULL AND distance_true < 0.5 AND {runs}
GROUP BY ALL
HAVING steps >= 20
ORDER BY ALL
"""

EPOCHS = """
-- error of the estimator after each epoch
SELECT estimator, split, epoch, mean_error, median_error, p95_error, loss, seconds
FROM epochs
WHERE {estimators}
ORDER BY estimator, split, epoch
"""

MISALIGNMENT = """
-- error of the estimator on frames it never saw, from the camera as trained and from one that was turned
SELECT estimator, misalignment_kind, misalignment_deg,
       avg(error) AS mean_error, median(error) AS median_error, quantile_cont(error, 0.95) AS p95_error,
       count(*) AS frames
FROM predictions
WHERE {estimators}
GROUP BY ALL
ORDER BY ALL
"""

VOLUME = """
-- how much was logged
SELECT count(DISTINCT run) AS runs, count(*) AS episodes, sum(length) AS transitions, sum(wall_time_s) AS seconds
FROM episodes
WHERE {runs}
"""

EXTREME_EPISODES = """
-- evaluation episodes (of the final evaluation where there is one), best and worst of each task first
WITH judged AS (
    SELECT run, task, split, episode, return_dense_true, success,
           max(split = 'final') OVER (PARTITION BY run) AS has_final
    FROM episodes WHERE split <> 'train' AND {runs}
)
SELECT run, task, split, episode, return_dense_true, success,
       row_number() OVER (PARTITION BY task ORDER BY return_dense_true DESC, run, episode) AS best,
       row_number() OVER (PARTITION BY task ORDER BY return_dense_true, run, episode) AS worst
FROM judged
WHERE (split = 'final') = has_final
QUALIFY best <= {count} OR worst <= {count}
ORDER BY task, best
"""


def which_runs(chosen: Sequence[Artifact], every: Sequence[Artifact]) -> str:
    """SQL condition for the chosen runs that did not fail, by name where all cells of a name are chosen."""
    names = {run.name.split("/")[0] for run in chosen}
    if {run.id for run in chosen} == {run.id for run in every if run.name.split("/")[0] in names}:
        condition = f"name IN ({_list(names)})"
    else:
        condition = f"run IN ({_list({run.name for run in chosen})})"
    return f"run IN (SELECT run FROM runs WHERE status <> 'failed' AND {condition})"


def which_estimators(chosen: Sequence[Artifact]) -> str:
    """SQL condition for the chosen estimators."""
    return f"estimator IN ({_list({estimator.name for estimator in chosen})})"


def _list(names: set[str]) -> str:
    return ", ".join("'" + name.replace("'", "''") + "'" for name in sorted(names)) or "NULL"
