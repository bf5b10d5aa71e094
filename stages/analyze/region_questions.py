"""The questions about the regions of the table where the cube starts, as SQL."""

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
-- (over the `compared` ones, for which the oracle has an episode from the same start)
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
       avg(return) AS mean_return, count(lost_return) AS compared, avg(lost_return) AS lost_return,
       max(estimation_error) AS worst_error, arg_max(run, estimation_error) AS worst_run,
       arg_max(episode, estimation_error) AS worst_episode
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
