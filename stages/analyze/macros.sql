-- The usual questions as macros of `pipeline sql`. What stands above a macro is what `pipeline sql --schema` says of it.
-- Functions whose name begins with _ are Python's: stages/analyze/macros.py.

-- Interquartile mean of a list of numbers: the quantile function integrated from 1/4 to 3/4, times two.
-- Example: SELECT scheme, iqm(list(final_return)) FROM runs GROUP BY ALL
CREATE MACRO iqm(numbers) AS _iqm(numbers::DOUBLE[]);

-- [low, high] of the percentile bootstrap of the mean of a list, the report's; of one number there is none.
-- Example: SELECT scheme, avg(final_return), mean_interval(list(final_return)) FROM runs GROUP BY ALL
CREATE MACRO mean_interval(numbers, confidence := 0.95) AS _mean_interval(numbers::DOUBLE[], confidence::DOUBLE);

-- [low, high] of the percentile bootstrap of the interquartile mean of a list, the report's.
-- Example: SELECT scheme, iqm_interval(list(final_return), confidence := 0.9) FROM runs GROUP BY ALL
CREATE MACRO iqm_interval(numbers, confidence := 0.95) AS _iqm_interval(numbers::DOUBLE[], confidence::DOUBLE);

-- Where each run ended: its final evaluation, or the last one made while training.
-- Example: FROM outcomes() ORDER BY mean_return DESC
CREATE MACRO outcomes() AS TABLE
    SELECT split_part(run, '/', 1) AS name, *
    FROM evaluations
    QUALIFY row_number() OVER (
        PARTITION BY run ORDER BY split = 'final' DESC, after_episode DESC, evaluation DESC
    ) = 1;

-- Mean and interquartile mean over seeds of where runs ended, with 95 % bootstrap intervals, by scheme and misalignment.
-- Failed runs are left out, running ones count with their last evaluation: `FROM runs` says which there are.
-- Example: FROM return_by_scheme() WHERE name = 'demo'
CREATE MACRO return_by_scheme() AS TABLE
    SELECT name, task, misalignment_kind, misalignment_deg, scheme, count(*) AS seeds,
           avg(mean_return) AS return, mean_interval(list(mean_return)) AS return_interval,
           iqm(list(mean_return)) AS iqm, iqm_interval(list(mean_return)) AS iqm_interval,
           avg(success_rate) AS success_rate
    FROM outcomes()
    GROUP BY name, task, misalignment_kind, misalignment_deg, scheme
    ORDER BY ALL;

-- How wrong the dense reward is, and which way, by how far the gripper truly is from the cube, in bins of `width` [m].
-- Example: FROM reward_error_by_distance(width := 0.05) WHERE run = 'demo/reach-dense-orbit00-seed0'
CREATE MACRO reward_error_by_distance(width := 0.02) AS TABLE
    SELECT run, width * (floor(distance_true / if(width > 0, width, error('width is positive'))) + 0.5) AS distance,
           avg(abs(reward_dense_est - reward_dense_true)) AS error,
           avg(reward_dense_est - reward_dense_true) AS bias,
           avg(estimation_error) AS estimation_error,
           count(*) AS steps
    FROM transitions
    WHERE reward_dense_est IS NOT NULL
    GROUP BY ALL
    ORDER BY ALL;

-- How soon the episodes of each run succeed: quartiles of the step, over those that do. One row per run and split.
-- Example: FROM steps_to_success() WHERE split = 'final'
CREATE MACRO steps_to_success() AS TABLE
    SELECT run, split, count(*) AS episodes, avg(success::INT) AS success_rate,
           quantile_cont(steps_to_success, 0.25) AS fast, median(steps_to_success) AS median,
           quantile_cont(steps_to_success, 0.75) AS slow
    FROM episodes
    GROUP BY ALL
    ORDER BY ALL;

-- Return of each training episode, averaged over a sliding window of `width` episodes: smoother than the evaluations.
-- Example: FROM training_curve(width := 10) WHERE name = 'demo' AND scheme = 'dense'
CREATE MACRO training_curve(width := 20) AS TABLE
    SELECT split_part(run, '/', 1) AS name, run, task, scheme, misalignment_kind, misalignment_deg, seed, phase,
           episode, avg(return_dense_true) OVER recent AS return, avg(success::INT) OVER recent AS success_rate
    FROM episodes
    WHERE split = 'train'
    WINDOW recent AS (PARTITION BY run ORDER BY episode ROWS BETWEEN width - 1 PRECEDING AND CURRENT ROW)
    ORDER BY run, episode;
