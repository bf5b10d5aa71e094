-- the evaluation episodes behind the figures' points (of the final evaluation where there is one): the best and the
-- worst of each task, and of each run the one whose return is its median
WITH judged AS (
    SELECT run, seed, main, split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, split, episode, return_dense_true, success,
           max(split = 'final') OVER (PARTITION BY run) AS has_final
    FROM episodes JOIN (SELECT run, name IN ('laptop') AS main FROM runs WHERE status <> 'failed' AND name IN ('laptop')) USING (run)
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
