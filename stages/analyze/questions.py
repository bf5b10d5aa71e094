"""The questions of the report, as SQL that anyone can ask again with `pipeline sql`."""

from collections.abc import Sequence

from stages.analyze.catalogue import Artifact
from stages.analyze.studies import Study

_GROUP = "split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme"

RUNS = """
-- every run, of the main matrix and of the studies beside it: what it is, how it went, the hash of what makes it again
SELECT run, name, task, scheme, misalignment_kind, misalignment_deg, seed, status, estimator,
       episodes, final_return, final_success_rate,
       config->>'$.policy.buffer' AS buffer, config->>'$.policy.reset' AS reset, config_sha256,
       {main} AS main
FROM runs
WHERE {every}
ORDER BY run
"""

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


STUDY_OUTCOMES = """
-- where each run of each study ended, and the main runs of the same task, scheme and misalignment beside it
WITH member (study, name, main) AS (VALUES {members}),
varied (study, position, key, path) AS (VALUES {keys}),
candidate AS (SELECT * FROM runs JOIN member USING (name)),
setting AS (
    SELECT DISTINCT study, task, scheme, misalignment_kind, misalignment_deg FROM candidate WHERE NOT main
),
settings AS (
    SELECT study, run, string_agg(key || ' = ' || coalesce(config->>path, '–'), '; ' ORDER BY position) AS settings
    FROM candidate JOIN varied USING (study)
    GROUP BY ALL
),
outcome AS (
    SELECT run, split, after_episode, episodes,
           mean_return, success_rate, mean_steps_to_success, mean_estimation_error
    FROM evaluations
    QUALIFY row_number() OVER (
        PARTITION BY run ORDER BY split = 'final' DESC, after_episode DESC, evaluation DESC
    ) = 1
)
SELECT c.study, c.main, s.settings, c.run, c.name, c.task, c.misalignment_kind, c.misalignment_deg, c.scheme, c.seed,
       c.status, o.split, o.after_episode, o.episodes,
       o.mean_return, o.success_rate, o.mean_steps_to_success, o.mean_estimation_error, c.config
FROM candidate AS c
JOIN setting USING (study, task, scheme, misalignment_kind, misalignment_deg)
JOIN settings AS s USING (study, run)
LEFT JOIN outcome AS o ON o.run = c.run
ORDER BY c.study, c.main, c.run
"""

_SITUATION = "name, task, misalignment_kind, misalignment_deg"

_FINAL_EPISODES = f"""
WITH step AS (
    SELECT run, episode,
           max(cube_true_x) FILTER (WHERE step = 0) AS x, max(cube_true_y) FILTER (WHERE step = 0) AS y,
           avg(abs(reward_dense_est - reward_dense_true)) AS reward_error
    FROM transitions
    WHERE split = 'final' AND {{runs}}
    GROUP BY run, episode
), episode AS (
    SELECT split_part(run, '/', 1) AS name, * EXCLUDE (split)
    FROM (SELECT run, task, misalignment_kind, misalignment_deg, scheme, seed, split, episode,
                 return_dense_true AS return, mean_estimation_error AS estimation_error FROM episodes)
    WHERE split = 'final' AND {{runs}}
), final AS (  -- with what the oracle gets from the same start
    SELECT e.*, s.x, s.y, s.reward_error, oracle.return - e.return AS lost_return
    FROM episode AS e JOIN step AS s USING (run, episode)
    LEFT JOIN (SELECT * FROM episode WHERE scheme = 'oracle') AS oracle
        USING ({_SITUATION}, seed, episode)
)"""

REGIONS = f"""
-- final episodes by where on the table the cube starts (5 × 5 regions): wrong estimate, wrong reward, lost return
{_FINAL_EPISODES.strip()},
region AS (
    SELECT final.*, half,
           least(4, greatest(0, floor(5 * (x + half) / (2 * half)))) AS column_x,
           least(4, greatest(0, floor(5 * (y + half) / (2 * half)))) AS row_y
    FROM final JOIN (SELECT run, (config->>'$.world.cube_half_range')::DOUBLE AS half FROM runs) USING (run)
    WHERE half > 0 AND x IS NOT NULL AND y IS NOT NULL
)
SELECT {_SITUATION}, scheme,
       half * (2 * column_x - 4) / 5 AS x, half * (2 * row_y - 4) / 5 AS y, 2 * half / 5 AS width,
       count(*) AS episodes, avg(estimation_error) AS estimation_error, avg(reward_error) AS reward_error,
       avg(return) AS mean_return, avg(lost_return) AS lost_return
FROM region
GROUP BY ALL
ORDER BY ALL
"""

REGION_CORRELATION = f"""
-- do the episodes with the worse estimate, or the worse reward, lose more return? Spearman's rank correlation
{_FINAL_EPISODES.strip()},
ranked AS (  -- equal values share the mean of their ranks
    SELECT *,
           rank() OVER (w ORDER BY estimation_error)
               + (count(*) OVER (PARTITION BY {_SITUATION}, scheme, estimation_error) - 1) / 2 AS estimation_rank,
           rank() OVER (w ORDER BY reward_error)
               + (count(*) OVER (PARTITION BY {_SITUATION}, scheme, reward_error) - 1) / 2 AS reward_rank,
           rank() OVER (w ORDER BY lost_return)
               + (count(*) OVER (PARTITION BY {_SITUATION}, scheme, lost_return) - 1) / 2 AS lost_rank
    FROM final
    WHERE scheme <> 'oracle' AND lost_return IS NOT NULL
      AND estimation_error IS NOT NULL AND reward_error IS NOT NULL
    WINDOW w AS (PARTITION BY {_SITUATION}, scheme)
)
SELECT {_SITUATION}, scheme, count(*) AS episodes,
       avg(estimation_error) AS estimation_error, avg(reward_error) AS reward_error, avg(lost_return) AS lost_return,
       nullif(corr(estimation_rank, lost_rank), 'NaN') AS estimation_correlation,
       nullif(corr(reward_rank, lost_rank), 'NaN') AS reward_correlation
FROM ranked
GROUP BY ALL
ORDER BY ALL
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


def study_members(studies: Sequence[Study]) -> str:
    """SQL rows (study, name of runs, whether they are the main ones)."""
    rows = [(study.name, name, name == study.main) for study in studies for name in (*study.runs, study.main)]
    return ", ".join(f"({_text(study)}, {_text(name)}, {str(main).lower()})" for study, name, main in rows)


def study_keys(studies: Sequence[Study]) -> str:
    """SQL rows (study, position, key, where a run's configuration has it)."""
    rows = [(study.name, position, key) for study in studies for position, key in enumerate(study.keys)]
    return ", ".join(f"({_text(study)}, {i}, {_text(key)}, {_text(f'$.{key}')})" for study, i, key in rows)


def _list(names: set[str]) -> str:
    return ", ".join(_text(name) for name in sorted(names)) or "NULL"


def _text(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"
