-- area under each run's learning curve over its length: the mean of its evaluations, which are equally far apart
SELECT run, split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, seed, avg(mean_return) AS area, max(after_episode) AS after_episode, count(*) AS evaluations
FROM evaluations
WHERE split = 'eval' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
GROUP BY ALL
ORDER BY run
