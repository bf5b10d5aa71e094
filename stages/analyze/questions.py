"""The questions of the report, as SQL that anyone can ask again with `pipeline sql`."""

from collections.abc import Sequence

from stages.analyze.catalogue import Artifact
from stages.analyze.sql_text import literal

_GROUP = "split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme"

RUNS = """
-- every run, of the main matrix and of the studies beside it: what it is, how it went, the hash of what makes it again
SELECT run, name, task, scheme, misalignment_kind, misalignment_deg, seed, status, estimator,
       episodes, final_return, final_success_rate,
       config->>'$.policy.buffer' AS buffer, config->>'$.policy.reset' AS reset,
       (config->>'$.policy.reset_updates')::INT AS reset_updates, config->>'$.world.robot' AS robot,
       (config->>'$.world.cube_half_range')::DOUBLE AS cube_half_range,
       (config->>'$.policy.episodes')::INT AS training_episodes,
       (config->>'$.policy.td3.gamma')::DOUBLE AS gamma,
       (config->>'$.policy.td3.exploration_noise')::DOUBLE AS exploration_noise,
       (config->>'$.policy.td3.preactivation_penalty')::DOUBLE AS preactivation_penalty,
       (config->>'$.policy.td3.exploration_correlation')::DOUBLE AS exploration_correlation,
       config->>'$.policy.proprioception' AS proprioception,
       config->>'$.policy.observation_scale' AS observation_scale, config_sha256,
       {main} AS main, config
FROM runs
WHERE {every}
ORDER BY run
"""

OUTCOMES = """
-- where each run ended: its final evaluation, or the last one made while training
SELECT run, name, task, misalignment_kind, misalignment_deg, scheme, seed, split, after_episode, episodes,
       mean_return, success_rate, mean_steps_to_success, mean_estimation_error
FROM outcomes()
WHERE {runs}
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

LEARNING_AREA = f"""
-- area under each run's learning curve over its length: the mean of its evaluations, which are equally far apart
SELECT run, {_GROUP}, seed, avg(mean_return) AS area, max(after_episode) AS after_episode, count(*) AS evaluations
FROM evaluations
WHERE split = 'eval' AND {{runs}}
GROUP BY ALL
ORDER BY run
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

REWARD_ERROR = f"""
-- how wrong the dense reward is, and which way, by how far the gripper truly is from the cube (bins of 2 cm)
SELECT {_GROUP}, 0.02 * floor(distance_true / 0.02) + 0.01 AS distance,
       avg(abs(reward_dense_est - reward_dense_true)) AS error,
       avg(reward_dense_est - reward_dense_true) AS bias,
       count(*) AS steps
FROM transitions
WHERE scheme <> 'oracle' AND reward_dense_est IS NOT NULL AND distance_true < 0.5 AND {{runs}}
GROUP BY ALL
HAVING steps >= 20
ORDER BY ALL
"""

ESTIMATORS = """
-- the estimators, and their error on the test episodes of their dataset [m]
SELECT estimator, status, dataset, epochs, parameters, test_mean_error, test_median_error, test_p95_error, config_sha256
FROM estimators
WHERE {estimators}
ORDER BY estimator
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
-- how much each run logged
SELECT run, count(*) AS episodes, sum(length)::BIGINT AS transitions, sum(wall_time_s) AS seconds
FROM episodes
WHERE {runs}
GROUP BY run
ORDER BY run
"""

EPISODES_BEHIND = f"""
-- the evaluation episodes behind the figures' points (of the final evaluation where there is one): the best and the
-- worst of each task, and of each run the one whose return is its median
WITH judged AS (
    SELECT run, seed, main, {_GROUP}, split, episode, return_dense_true, success,
           max(split = 'final') OVER (PARTITION BY run) AS has_final
    FROM episodes JOIN (SELECT run, {{main}} AS main FROM runs WHERE status <> 'failed' AND {{every}}) USING (run)
    WHERE split <> 'train'
), ranked AS (
    SELECT *,
           main AND 1 = row_number() OVER (PARTITION BY main, task
               ORDER BY return_dense_true DESC, run, episode) AS best,
           main AND 1 = row_number() OVER (PARTITION BY main, task ORDER BY return_dense_true, run, episode) AS worst,
           row_number() OVER (PARTITION BY run ORDER BY return_dense_true, episode)
               = (count(*) OVER (PARTITION BY run) + 1) // 2 AS typical
    FROM judged
    WHERE (split = 'final') = has_final
)
SELECT * EXCLUDE (has_final)
FROM ranked
WHERE best OR worst OR typical
ORDER BY run, episode
"""


def named(chosen: Sequence[Artifact], every: Sequence[Artifact]) -> str:
    """SQL condition on `runs` for the chosen ones, by name where all cells of a name are chosen."""
    names = {run.name.split("/")[0] for run in chosen}
    if {run.id for run in chosen} == {run.id for run in every if run.name.split("/")[0] in names}:
        return f"name IN ({_list(names)})"
    return f"run IN ({_list({run.name for run in chosen})})"


def logged(condition: str) -> str:
    """SQL condition on logs: of the runs under `condition` those that did not fail."""
    return f"run IN (SELECT run FROM runs WHERE status <> 'failed' AND {condition})"


def which_estimators(chosen: Sequence[Artifact]) -> str:
    """SQL condition for the chosen estimators."""
    return f"estimator IN ({_list({estimator.name for estimator in chosen})})"


def _list(names: set[str]) -> str:
    return ", ".join(literal(name) for name in sorted(names)) or "NULL"
