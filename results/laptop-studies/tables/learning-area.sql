-- area under each run's learning curve over its length: the mean of its evaluations, which are equally far apart
SELECT run, split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, seed, avg(mean_return) AS area, max(after_episode) AS after_episode, count(*) AS evaluations
FROM evaluations
WHERE split = 'eval' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND run IN ('laptop/lift-oracle-orbit00-seed2', 'laptop/reach-dense2sparse-orbit10-seed0', 'laptop/reach-dense2sparse-orbit10-seed1', 'laptop/reach-dense2sparse-orbit10-seed2'))
GROUP BY ALL
ORDER BY run
