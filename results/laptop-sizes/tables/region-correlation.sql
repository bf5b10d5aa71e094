-- do the episodes with the worse estimate, or the worse reward, lose more return? Spearman's rank correlation
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
ranked AS (  -- equal values share the mean of their ranks
    SELECT *,
           rank() OVER (w ORDER BY estimation_error)
               + (count(*) OVER (PARTITION BY name, task, misalignment_kind, misalignment_deg, scheme, estimation_error) - 1) / 2 AS estimation_rank,
           rank() OVER (w ORDER BY reward_error)
               + (count(*) OVER (PARTITION BY name, task, misalignment_kind, misalignment_deg, scheme, reward_error) - 1) / 2 AS reward_rank,
           rank() OVER (w ORDER BY lost_return)
               + (count(*) OVER (PARTITION BY name, task, misalignment_kind, misalignment_deg, scheme, lost_return) - 1) / 2 AS lost_rank
    FROM final
    WHERE scheme <> 'oracle' AND lost_return IS NOT NULL
      AND estimation_error IS NOT NULL AND reward_error IS NOT NULL
    WINDOW w AS (PARTITION BY name, task, misalignment_kind, misalignment_deg, scheme)
)
SELECT name, task, misalignment_kind, misalignment_deg, scheme, count(*) AS episodes,
       avg(estimation_error) AS estimation_error, avg(reward_error) AS reward_error, avg(lost_return) AS lost_return,
       nullif(corr(estimation_rank, lost_rank), 'NaN') AS estimation_correlation,
       nullif(corr(reward_rank, lost_rank), 'NaN') AS reward_correlation
FROM ranked
GROUP BY ALL
ORDER BY ALL
