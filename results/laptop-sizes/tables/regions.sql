-- final episodes by where on the table the cube starts (5 × 5 regions): wrong estimate, wrong reward, lost return
-- (over the `compared` ones, for which the oracle has an episode from the same start)
WITH step AS (
    SELECT run, episode,
           max(cube_true_x) FILTER (WHERE step = 0) AS x, max(cube_true_y) FILTER (WHERE step = 0) AS y,
           avg(abs(reward_dense_est - reward_dense_true)) AS reward_error
    FROM transitions
    WHERE split = 'final' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
    GROUP BY run, episode
), episode AS (
    SELECT split_part(run, '/', 1) AS name, * EXCLUDE (split)
    FROM (SELECT run, task, misalignment_kind, misalignment_deg, scheme, seed, split, episode,
                 return_dense_true AS return, mean_estimation_error AS estimation_error FROM episodes)
    WHERE split = 'final' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
), final AS (  -- with what the oracle gets from the same start
    SELECT e.*, s.x, s.y, s.reward_error, oracle.return - e.return AS lost_return
    FROM episode AS e JOIN step AS s USING (run, episode)
    LEFT JOIN (SELECT * FROM episode WHERE scheme = 'oracle') AS oracle
        USING (name, task, misalignment_kind, misalignment_deg, seed, episode)
),
region AS (
    SELECT final.*, half,
           least(4, greatest(0, floor(5 * (x + half) / (2 * half)))) AS column_x,
           least(4, greatest(0, floor(5 * (y + half) / (2 * half)))) AS row_y
    FROM final JOIN (SELECT run, (config->>'$.world.cube_half_range')::DOUBLE AS half FROM runs) USING (run)
    WHERE half > 0 AND x IS NOT NULL AND y IS NOT NULL
)
SELECT name, task, misalignment_kind, misalignment_deg, scheme,
       half * (2 * column_x - 4) / 5 AS x, half * (2 * row_y - 4) / 5 AS y, 2 * half / 5 AS width,
       count(*) AS episodes, avg(estimation_error) AS estimation_error, avg(reward_error) AS reward_error,
       avg(return) AS mean_return, count(lost_return) AS compared, avg(lost_return) AS lost_return,
       max(estimation_error) AS worst_error, arg_max(run, estimation_error) AS worst_run,
       arg_max(episode, estimation_error) AS worst_episode
FROM region
GROUP BY ALL
ORDER BY ALL
