-- mean and spread over seeds of the evaluations made while training
SELECT split_part(run, '/', 1) AS name, task, misalignment_kind, misalignment_deg, scheme, after_episode,
       avg(mean_return) AS mean, stddev_samp(mean_return) AS std, count(*) AS seeds
FROM evaluations
WHERE split = 'eval' AND run IN (SELECT run FROM runs WHERE status <> 'failed' AND name IN ('laptop'))
GROUP BY ALL
ORDER BY ALL
